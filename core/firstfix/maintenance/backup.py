"""Copy of a store to another one: a backup, its restoration, or a move to another cloud.

It copies maps with their logs, sources and georeferences, builds, and API keys. It does not copy ``stages/``,
``uploads/``, ``idempotency/``, ``callers/``, ``changes/`` and ``checked/``, which are made again when needed,
nor ``recorded-queries/``, nor the sightings of versions (``firstfix.catalog.sightings``): queries make
new ones.

Both stores may be in use. The logs are read first and written last. So every version in the copy's logs was
whole when it was read, and readers of the copy never see a version before its files. Nothing is removed, and
nothing is replaced except the status of builds and damaged objects. So an interrupted copy can be continued,
and an older one can be updated. A map whose log is another one in the target is left out, with its builds.

A file that the copy already has is compared by its sha256, not only by its size. For this it is read once in
``CHECKED_FOR`` (``firstfix.maintenance.checked_objects``), and copied again if it differs.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import timedelta

from ..builds.records import BuildRecords
from ..catalog.log.change_log import ChangeLog
from ..catalog.log.map_log import MapLog
from ..catalog.manifest import FILE_NAME
from ..catalog.sources import sha256_of_source
from ..catalog.versions.objects import VersionFolder
from ..errors import CorruptVersion, InvalidOption, NotFound, UnreadableRecord
from ..ids import is_name
from ..store.store import Store, StoredObject
from .checked_objects import CheckedObjects
from .record_copies import Copies, compare_copies
from .record_kinds import why_unreadable

_AT_ONCE = 4
_REPLACED = ("/status.json", "/stages.json")  # of a build; all other objects are created once
_FOLDERS = ("maps", "builds", "keys")
CHECKED_FOR = timedelta(days=30)


@dataclass
class CopyReport:
    """Result of a copy.

    Attributes:
        objects: number of copied objects.
        bytes: size of the copied objects.
        mended: keys that were damaged in the target and were copied again.
        damaged: keys that are missing or damaged in the source. They are not copied.
        conflicts: keys under which the target has other content: there it is not a copy of the source. They
            are not copied, and if one is in a map's log, nothing of this map is.
    """

    objects: int = 0
    bytes: int = 0
    mended: list[str] = field(default_factory=list)
    damaged: list[str] = field(default_factory=list)
    conflicts: list[str] = field(default_factory=list)


def copy_store(source: Store, target: Store) -> CopyReport:
    """Copy a store, and verify every file by its sha256 on the way.

    Raises:
        StoreError, ReadOnly: a store failed. A repeated call continues.
    """
    return _Copy(source, target).run()


class _Copy:
    def __init__(self, source: Store, target: Store) -> None:
        self._source = source
        self._target = target
        self._there: dict[str, StoredObject] = {}  # objects of the target, by key
        self._copied: set[str] = set()  # verified files of the current map in the target
        self._maps_of_builds: dict[str, str] = {}
        self._report = CopyReport()

    def run(self) -> CopyReport:
        self._there = {found.key: found for name in _FOLDERS for found in self._target.scan(name)}
        map_ids = [name for name in self._source.folders("maps") if is_name(name)]
        logs = {map_id: self._read_log(map_id) for map_id in map_ids}
        logs = {map_id: log for map_id, log in logs.items() if not self._is_other_map(log)}
        builds = self._source.list("builds")  # before the sources, which are put before the builds
        for map_id in logs:
            self._copy_files_of(map_id)
            self._write(self._read(f"maps/{map_id}/georeference"))
        left_out = frozenset(map_ids) - logs.keys()
        for key in builds:
            with suppress(NotFound):  # collected meanwhile
                if not left_out or self._map_of_build(key) not in left_out:
                    self._write({key: self._source.get(key)})
        self._write(self._read("keys"))
        for map_id, log in logs.items():
            if self._write(log):
                ChangeLog(self._target).note(map_id)
        return self._report

    def _read(self, folder: str) -> dict[str, bytes]:
        """Read the small objects of a folder, in order."""
        return {key: self._source.get(key) for key in self._source.list(folder)}

    def _read_log(self, map_id: str) -> dict[str, bytes]:
        """Read entries, then snapshots, which may contain entries that were collected meanwhile."""
        return {**self._read(f"maps/{map_id}/log"), **self._read(f"maps/{map_id}/snapshots")}

    def _copy_files_of(self, map_id: str) -> None:
        """Copy the sources of a map, and the versions that can be served."""
        checked = CheckedObjects(self._target, map_id)
        self._copy_sources(map_id, checked)
        state = MapLog(self._source, f"maps/{map_id}/log").state()
        for version in state.published:
            folder = VersionFolder(map_id, version, state.generation(version))
            self._copy_version(folder.key, version, checked)
        there = {item.key: item for item in self._target.scan(f"maps/{map_id}")}
        for key in self._copied & there.keys():
            checked.note(there[key])
        self._copied.clear()
        checked.save(set(there))

    def _write(self, objects: Mapping[str, bytes]) -> bool:
        """Put records that the target lacks. Returns whether there were any."""
        before = self._report.objects
        for key, data in objects.items():
            if why_unreadable(key, data) is not None:
                self._report.damaged.append(key)
                continue
            if key.endswith(_REPLACED):
                if key in self._there and self._target.get(key) == data:
                    continue
                self._target.put(key, data)
            elif key in self._there or not self._target.put_new(key, data):
                copies = compare_copies(key, data, self._target.get(key))
                if copies is Copies.DIFFERENT:
                    self._report.conflicts.append(key)
                if copies is not Copies.TARGET_DAMAGED:
                    continue
                self._mend(key, data)
            self._count(len(data))
        return self._report.objects > before

    def _mend(self, key: str, data: bytes) -> None:
        self._target.put(key, data)
        self._report.mended.append(key)

    def _is_other_map(self, log: Mapping[str, bytes]) -> bool:
        """Whether the target has another log under this map's name, and notes where they differ."""
        conflicts = [
            key
            for key in sorted(log.keys() & self._there.keys())
            if compare_copies(key, log[key], self._target.get(key)) is Copies.DIFFERENT
        ]
        self._report.conflicts += conflicts
        return bool(conflicts)

    def _map_of_build(self, key: str) -> str:
        """Map of a build, by the key of one of its records; empty if nobody can tell."""
        build_id = key.split("/")[1]
        if build_id not in self._maps_of_builds:
            try:
                request = BuildRecords(self._source).request(build_id)
            except (NotFound, UnreadableRecord, InvalidOption):
                request = {}
            self._maps_of_builds[build_id] = str(request.get("map_id", ""))
        return self._maps_of_builds[build_id]

    def _count(self, size: int) -> None:
        self._report.objects += 1
        self._report.bytes += size

    def _copy_sources(self, map_id: str, checked: CheckedObjects) -> None:
        keys = self._source.list(f"maps/{map_id}/sources")
        damaged = self._copy_files({key: sha256_of_source(key) for key in keys}, checked)
        self._report.damaged += filter(self._source.exists, damaged)  # others were collected meanwhile

    def _copy_version(self, folder: str, version: str, checked: CheckedObjects) -> None:
        """Copy a version's files, then its manifest. Of any format: another release can serve it."""
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
        wanted = {f"{folder}/{name}": entry["sha256"] for name, entry in files.items()}
        damaged = self._copy_files(wanted, checked)
        self._report.damaged += damaged
        if damaged:
            return
        if key not in self._there:
            self._write({key: manifest})
        elif self._target.get(key) != manifest:
            self._mend(key, manifest)

    def _copy_files(self, wanted: Mapping[str, str], checked: CheckedObjects) -> list[str]:
        """Copy files. Returns the keys of damaged ones.

        Args:
            wanted: keys with their sha256.
        """
        damaged = []
        with ThreadPoolExecutor(_AT_ONCE, thread_name_prefix="copy") as pool:
            todo = [
                (key, sha256)
                for key, sha256 in wanted.items()
                if key not in self._there or not checked.is_fresh(self._there[key], CHECKED_FOR)
            ]
            for (key, _), copied in zip(todo, pool.map(self._copy_file, todo), strict=True):
                if copied is None:
                    damaged.append(key)
                    continue
                self._copied.add(key)
                if copied:
                    self._count(copied)
                    if key in self._there:
                        self._report.mended.append(key)
        return damaged

    def _copy_file(self, wanted: tuple[str, str]) -> int | None:
        """Copy a file. Returns its size; 0 if the target has it; None if it is damaged."""
        key, sha256 = wanted
        try:
            if key in self._there and self._target.sha256(key) == sha256:
                return 0
            size = self._source.size(key)
            self._target.put_pieces(key, pieces_of(self._source, key, sha256))
        except (NotFound, CorruptVersion):
            return None
        return size


def pieces_of(store: Store, key: str, sha256: str) -> Iterator[bytes]:
    """Read an object piece by piece, and verify its sha256.

    Raises:
        NotFound: no such key.
        CorruptVersion: the object has another sha256; raised after the last piece.
    """
    digest = hashlib.sha256()
    for piece in store.pieces(key):
        digest.update(piece)
        yield piece
    if digest.hexdigest() != sha256:
        raise CorruptVersion(f"{key} has another sha256")
