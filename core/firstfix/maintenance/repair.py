"""Repair of a store's damaged objects from other copies of their content.

    file of a version, source    copied from any object or local file with the same sha256
    record with one flipped bit  the bit is flipped back: the record's checksum tells which
    status of a build            made from the map's log; otherwise the build is queued again
    entry of a map's log         made from a snapshot that contains it
    notice of a change           replaced by a void one
    any other record             moved below ``quarantine/``, as if it did not exist

Three kinds are left for people, if more than one bit is wrong: an entry of a log that no snapshot contains,
because its number must not be used twice; the valid georeference, because the one before would give wrong
positions; and a version's manifest.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from ..builds.attempts import has_open_attempt
from ..builds.records import new_status
from ..builds.shared_stages import ROOT as STAGES
from ..catalog.catalog import Catalog
from ..catalog.log.change_log import notice_json
from ..catalog.log.map_log import read_snapshot, snapshots_of
from ..catalog.log.map_state import Event
from ..catalog.manifest import FILE_NAME
from ..catalog.sources import sha256_of_source
from ..catalog.versions.objects import VersionFolder
from ..errors import CorruptVersion, FirstfixError, NotFound, TooLarge, UnreadableRecord
from ..ids import is_name
from ..store.flipped_bit import with_bit_restored
from ..store.json_record import RecordKind, max_bytes
from ..store.numbered import number_of, scan_after
from ..store.sha256 import sha256_of
from ..store.store import Store
from .backup import pieces_of

QUARANTINE = "quarantine"


class Repair:
    """Repair during one round through a store. Not thread-safe.

    Args:
        cache: directory of the cache of versions on this machine (``firstfix.catalog.versions.cache``).
    """

    def __init__(self, store: Store, cache: Path | None = None) -> None:
        self._store = store
        self._catalog = Catalog(store)
        self._cache = cache
        self._copies: dict[str, list[str]] | None = None  # sha256 to the keys that should have it
        self._special: dict[RecordKind, Callable[[str], str]] = {
            RecordKind.BUILD_REQUEST: self._build_request,
            RecordKind.BUILD_STATUS: self._build_status,
            RecordKind.LOG_ENTRY: self._log_entry,
            RecordKind.CHANGE_NOTICE: self._change_notice,
            RecordKind.GEOREFERENCE: self._georeference,
        }

    def file(self, key: str, sha256: str) -> str:
        """Put the right content under a key. Returns where it was copied from; empty if there is no copy."""
        for other in self._found_copies().get(sha256, ()):
            if other != key:
                with suppress(NotFound, CorruptVersion):
                    self._store.put_pieces(key, pieces_of(self._store, other, sha256))
                    return f"copied from {other}"
        local = self._local_copy(key)
        if local is not None and local.is_file() and sha256_of(local) == sha256:
            self._store.put_file(key, local)
            return f"copied from {local}"
        return ""

    def record(self, key: str, kind: RecordKind) -> str:
        """Repair a damaged record or move it aside. Returns what was done; empty if nothing was."""
        with suppress(NotFound, TooLarge):
            data = with_bit_restored(self._store.get(key, max_bytes=max_bytes(kind)), kind)
            if data is not None:
                self._keep(key)
                self._store.put(key, data)
                return "one bit was flipped back"
        return self._special.get(kind, self._aside)(key)

    def _aside(self, key: str) -> str:
        self._keep(key)
        self._store.delete(key)
        return f"moved to {QUARANTINE}/{key}"

    def _keep(self, key: str) -> None:
        with suppress(NotFound):
            self._store.put_pieces(f"{QUARANTINE}/{key}", self._store.pieces(key))

    def _build_request(self, key: str) -> str:
        """Move all records of a build aside: without its request it can neither run nor be shown."""
        build_id = key.split("/")[1]
        if has_open_attempt(self._store, build_id):
            return ""
        for part in [key, *self._store.list(f"builds/{build_id}")]:
            self._aside(part)
        return f"the build was moved to {QUARANTINE}/builds/{build_id}"

    def _build_status(self, key: str) -> str:
        build_id = key.split("/")[1]
        try:
            request = self._catalog.builds.request(build_id)
        except (NotFound, UnreadableRecord):
            return self._aside(key)
        map_id = request.get("map_id", "")
        published: dict[bool, str | None] = {False: None, True: None}  # the last one, provisional or not
        for entry in self._catalog.log(map_id) if is_name(map_id) else ():
            if (entry.event, entry.build_id) == (Event.PUBLISHED, build_id):
                published[entry.provisional] = entry.version
        if published[False] is None:
            return f"{self._aside(key)}; the build is queued again"
        self._keep(key)
        status = new_status(
            "succeeded",
            map_id=map_id,
            stage="publish",
            progress=1.0,
            version=published[False],
            provisional_version=published[True],
        )
        self._catalog.builds.set_status(build_id, status)
        return "written again: the map's log shows that the build has succeeded"

    def _log_entry(self, key: str) -> str:
        seq = number_of(key)
        folder = key.rsplit("/", 1)[0]
        for number in scan_after(self._store, snapshots_of(folder), (seq or 1) - 1):
            state = read_snapshot(self._store, snapshots_of(folder), number)
            for entry in () if state is None else state.entries:
                if entry.seq == seq:
                    self._keep(key)
                    self._store.put(key, entry.to_json())
                    return f"written again from snapshot {number}"
        return ""

    def _change_notice(self, key: str) -> str:
        self._keep(key)
        self._store.put(key, notice_json(None))
        return "replaced by a void one"

    def _georeference(self, key: str) -> str:
        folder = key.rsplit("/", 1)[0]
        last = max(scan_after(self._store, folder, 0), default=0)
        return "" if number_of(key) == last else self._aside(key)

    def _found_copies(self) -> dict[str, list[str]]:
        """All objects by the sha256 that they should have. Listed once."""
        if self._copies is None:
            self._copies = {}
            for map_id in self._catalog.folder_names():
                for key in self._store.list(f"maps/{map_id}/sources"):
                    self._copies.setdefault(sha256_of_source(key), []).append(key)
                state = self._catalog.state(map_id)
                for version in state.published:
                    self._copies_of(VersionFolder(map_id, version, state.generation(version)))
            for key in self._store.list(STAGES):
                self._copies.setdefault(key.rsplit("/", 1)[-1], []).append(key)
        return self._copies

    def _copies_of(self, folder: VersionFolder) -> None:
        assert self._copies is not None
        with suppress(FirstfixError):  # a damaged version has no files to copy
            for name, entry in self._catalog.manifest(folder.map_id, folder.version).files.items():
                self._copies.setdefault(entry.sha256, []).append(f"{folder.key}/{name}")

    def _local_copy(self, key: str) -> Path | None:
        parts = key.split("/")
        if self._cache is None or parts[2:3] != ["versions"] or parts[-1] == FILE_NAME:
            return None
        return self._cache / parts[3].split(".")[0] / "/".join(parts[4:])
