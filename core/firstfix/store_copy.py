"""A store into another one: a backup, its restoration, a move to another cloud.

What lasts is copied: maps, with their logs, sources and georeferences; builds; API keys. Not copied are
``stages/``, ``uploads/``, ``idempotency/``, ``callers/`` and ``changes/``, which make themselves anew, and
``samples/``.

Both stores may be in use. The logs are read first and written last: so every version that the copy's logs
name was whole when it was read, and nobody who reads the copy sees a version before its files. Nothing is
removed or, but for the state of a build, replaced: a copy that was broken off is gone on with, and one of
yesterday is brought up to date.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field

from .change_log import ChangeLog
from .errors import Conflict, CorruptVersion, NotFound
from .ids import is_name
from .manifest import FILE_NAME
from .map_log import LogEntry, MapState
from .store import CHUNK_BYTES, Store
from .version_objects import VersionFolder

_AT_ONCE = 4
_REPLACED = ("/status.json", "/stages.json")  # of a build; everything else is created once
_FOLDERS = ("maps", "builds", "keys")


@dataclass
class CopyReport:
    """What a copy did.

    Attributes:
        objects: that were copied.
        bytes: of them.
        damaged: keys in the source that are missing, or not what their name or manifest says. Not copied.
    """

    objects: int = 0
    bytes: int = 0
    damaged: list[str] = field(default_factory=list)


def copy_store(source: Store, target: Store) -> CopyReport:
    """Copies what lasts, and checks every file by its sha256 on the way.

    Raises:
        Conflict: the target has something else under a key: it is no copy of the source. If it is a map's
            log, nothing was written.
        StoreError, ReadOnly: as the stores; to repeat it is to go on.
    """
    return _Copy(source, target).run()


class _Copy:
    def __init__(self, source: Store, target: Store) -> None:
        self._source = source
        self._target = target
        self._sizes: dict[str, int] = {}  # of what the target has, by key
        self._report = CopyReport()

    def run(self) -> CopyReport:
        self._sizes = {found.key: found.size_bytes for name in _FOLDERS for found in self._target.scan(name)}
        map_ids = [name for name in self._source.folders("maps") if is_name(name)]
        logs = {map_id: self._read(f"maps/{map_id}/log") for map_id in map_ids}
        for log in logs.values():
            for key in log.keys() & self._sizes.keys():
                self._compare(key, log[key])
        builds = self._source.list("builds")  # before the sources, which are put before the builds
        for map_id, log in logs.items():
            self._copy_sources(map_id)
            state = _state(log)
            for version in state.published:
                folder = VersionFolder(map_id, version, state.generation(version))
                self._copy_version(folder.key, version)
            self._write(self._read(f"maps/{map_id}/georeference"))
        for key in builds:
            with suppress(NotFound):  # collected meanwhile
                self._write({key: self._source.get(key)})
        self._write(self._read("keys"))
        for map_id, log in logs.items():
            if self._write(log):
                ChangeLog(self._target).note(map_id)
        return self._report

    def _read(self, folder: str) -> dict[str, bytes]:
        """The small objects of a folder, in their order."""
        return {key: self._source.get(key) for key in self._source.list(folder)}

    def _write(self, objects: Mapping[str, bytes]) -> bool:
        """Whether there was anything new."""
        before = self._report.objects
        for key, data in objects.items():
            if key.endswith(_REPLACED):
                if key in self._sizes and self._target.get(key) == data:
                    continue
                self._target.put(key, data)
            elif key in self._sizes or not self._target.put_new(key, data):
                self._compare(key, data)
                continue
            self._count(len(data))
        return self._report.objects > before

    def _compare(self, key: str, data: bytes) -> None:
        if self._target.get(key) != data:
            raise Conflict(f"{key} is another one there: the target is no copy of this store")

    def _count(self, size: int) -> None:
        self._report.objects += 1
        self._report.bytes += size

    def _copy_sources(self, map_id: str) -> None:
        keys = self._source.list(f"maps/{map_id}/sources")
        damaged = self._copy_files({key: key.rsplit("/", 1)[-1].split(".")[0] for key in keys})
        self._report.damaged += filter(self._source.exists, damaged)  # others were collected meanwhile

    def _copy_version(self, folder: str, version: str) -> None:
        """Its files, then its manifest. Of any format: what this program cannot serve another one can."""
        key = f"{folder}/{FILE_NAME}"
        try:
            manifest = self._source.get(key)
        except NotFound:
            self._report.damaged.append(key)
            return
        if hashlib.sha256(manifest).hexdigest() != version:
            self._report.damaged.append(key)
            return
        files = json.loads(manifest)["files"]
        damaged = self._copy_files({f"{folder}/{name}": entry["sha256"] for name, entry in files.items()})
        self._report.damaged += damaged
        if not damaged:
            self._write({key: manifest})

    def _copy_files(self, wanted: Mapping[str, str]) -> list[str]:
        """The keys that are damaged. Args: wanted: keys, with the sha256 that they must have."""
        damaged = []
        with ThreadPoolExecutor(_AT_ONCE, thread_name_prefix="copy") as pool:
            for key, copied in zip(wanted, pool.map(self._copy_file, wanted.items()), strict=True):
                if copied is None:
                    damaged.append(key)
                elif copied:
                    self._count(copied)
        return damaged

    def _copy_file(self, wanted: tuple[str, str]) -> int | None:
        """Bytes that were copied, 0: it was there; None: it is damaged."""
        key, sha256 = wanted
        try:
            size = self._source.size(key)
            if self._sizes.get(key) == size:
                return 0
            self._target.put_pieces(key, self._checked_pieces(key, size, sha256))
        except (NotFound, CorruptVersion):
            return None
        return size

    def _checked_pieces(self, key: str, size: int, sha256: str) -> Iterator[bytes]:
        """
        Raises:
            CorruptVersion: in place of the last piece.
        """
        digest = hashlib.sha256()
        for start in range(0, size, CHUNK_BYTES):
            piece = self._source.get_range(key, start, CHUNK_BYTES)
            digest.update(piece)
            if start + CHUNK_BYTES >= size and digest.hexdigest() != sha256:
                raise CorruptVersion(f"{key} has another sha256")
            yield piece


def _state(log: Mapping[str, bytes]) -> MapState:
    """What a map's log adds up to; entries that cannot be read are passed over."""
    entries = []
    for number, data in enumerate(log.values(), 1):
        with suppress(ValueError):
            entries.append(LogEntry.from_json(number, data))
    return MapState.of(tuple(entries), len(log))
