"""Maps, their versions and builds in an object store.

    maps/<map_id>/sources/<sha256>                  uploaded clouds, by content
    maps/<map_id>/sources/<sha256>.<build_id>       a copy for one build, as somebody was removing the other
    maps/<map_id>/versions/<digest>/...             files of a version; see ``firstfix.catalog.versions.objects``
    maps/<map_id>/versions/<digest>/manifest.json   written last
    maps/<map_id>/log/000001.json, ...              see ``firstfix.catalog.log.map_log``
    maps/<map_id>/snapshots/000050.json, ...        the same
    changes/00000001.json, ...                      see ``firstfix.catalog.log.change_log``
    builds/<build_id>/...                           see ``firstfix.builds.records``

A version without a manifest does not exist, and one without a ``published`` entry in the log is not
seen: so a publish that dies at any point has either published or not, and can be repeated.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path

from ..builds.records import BuildRecords
from ..errors import Conflict, NotFound, StoreError, StoreUnavailable
from ..ids import check_build_id, check_map_id, check_version, is_name
from ..store.sha256 import sha256_of
from ..store.store import Store
from .log.change_log import ChangeLog
from .log.map_log import MapLog
from .log.map_state import Event, LogEntry, MapState
from .manifest import Manifest
from .versions.garbage import collect_versions
from .versions.objects import VersionFolder, VersionObjects

_log = logging.getLogger(__name__)
_MAX_COLLECTIONS = 5  # that one publish meets


@dataclass(frozen=True)
class VersionInfo:
    """One version of a map that can be served.

    Attributes:
        published_time: UTC, ISO 8601.
    """

    version: str
    active: bool
    published_time: str


class Catalog(BuildRecords):
    """What the builder writes and the service reads. Thread-safe.

    Every method raises InvalidOption for an id or version that is none, and StoreUnavailable or
    StoreError as the store does.
    """

    def __init__(self, store: Store) -> None:
        super().__init__(store)
        self.changes = ChangeLog(store)
        self._logs: dict[str, MapLog] = {}  # of maps that there are: ids that were made up leave no trace
        self._objects = VersionObjects(store)
        self._lock = threading.Lock()

    # Maps and versions

    def map_ids(self) -> list[str]:
        """Maps that have a version to serve."""
        return [name for name in self.folder_names() if self.state(name).published]

    def folder_names(self) -> list[str]:
        """Ids that something is stored under, whether or not there is a version yet. One listing."""
        return [name for name in self.store.folders("maps") if is_name(name)]

    def state(self, map_id: str) -> MapState:
        """What the map's log adds up to; of a map that does not exist: nothing."""
        log = self._map_log(map_id)
        state = log.state()
        with self._lock:
            if state.last_seq:
                self._logs.setdefault(map_id, log)
        return state

    def known_state(self, map_id: str) -> MapState:
        """As ``state``, as of the last time that it was read: the store is not asked."""
        return self._map_log(map_id).known_state()

    def log(self, map_id: str) -> list[LogEntry]:
        """The newest entries of the map's log, and of the older ones those that still matter
        (``MapState.entries``)."""
        return list(self.state(map_id).entries)

    def active_version(self, map_id: str) -> str | None:
        return self.state(map_id).active

    def versions(self, map_id: str) -> list[VersionInfo]:
        """Versions that can be served, newest first.

        Raises:
            NotFound: the map has none and never had.
        """
        state = self.state(map_id)
        if not state.exists:
            raise NotFound(f"no map {map_id}")
        times = {e.version: e.time for e in state.entries if e.event is Event.PUBLISHED}
        return [
            VersionInfo(version, version == state.active, times[version])
            for version in reversed(state.published)
            if self._objects.exists(_folder(map_id, version, state))
        ]

    def manifest(self, map_id: str, version: str) -> Manifest:
        """
        Raises:
            NotFound: the map has no such version, or it was retired.
            CorruptVersion: the manifest is missing or is not the one that the version is named by.
            IncompatibleVersion: its format is not this reader's.
        """
        return self._objects.manifest(self._published(map_id, version))

    def fetch_version(self, map_id: str, version: str, directory: Path) -> Path:
        """The local folder with the version's files, each verified by its sha256; in the cache
        directory, or in the store itself when that is a directory. Safe to call concurrently.

        Raises:
            NotFound, IncompatibleVersion: as ``manifest``.
            CorruptVersion: as ``manifest``, or a file is missing or differs.
        """
        return self._objects.fetch(self._published(map_id, version), directory)

    def read_file(self, map_id: str, version: str, name: str, *, max_bytes: int) -> bytes:
        """One file of a version, checked by its sha256.

        Raises:
            NotFound: the version has no such file, or as ``manifest``.
            TooLarge: it is over the limit.
            CorruptVersion: as ``manifest``, or the file is missing or differs.
        """
        return self._objects.read_file(self._published(map_id, version), name, max_bytes=max_bytes)

    def publish(
        self,
        map_id: str,
        directory: Path,
        manifest: Manifest,
        *,
        build_id: str = "",
        told: Callable[[float], None] = lambda done: None,
    ) -> str:
        """Puts a version's files, then its manifest, then says so in the log and activates it.

        Repeating it after a kill at any point completes it. With a build id each log entry is written
        once for that build, so that a repeat does not undo what somebody did in between. A garbage
        collection of the version at the same time does no harm: either it sees the publish, or the publish
        sees it and puts the files anew.

        Args:
            told: called as the files are put with the share that is done, 0..1.

        Returns:
            the version's digest.

        Raises:
            CorruptVersion: a file in the directory is not what the manifest says.
        """
        version = manifest.digest
        log = self._map_log(map_id)

        def done(event: Event, state: MapState) -> bool:
            return bool(build_id) and any(
                (e.event, e.version, e.build_id) == (event, version, build_id) for e in state.entries
            )

        for _ in range(_MAX_COLLECTIONS):
            generation = self.state(map_id).generation(version)
            self._objects.put(VersionFolder(map_id, version, generation), directory, manifest, told)

            def is_needed(state: MapState, generation: int = generation) -> bool:
                if version in state.published or done(Event.PUBLISHED, state):
                    return False
                if state.generation(version) != generation:
                    raise _Collected
                return True

            with suppress(_Collected):
                published = log.append(
                    Event.PUBLISHED, version, build_id=build_id, generation=generation, needed=is_needed
                )
                break
        else:
            raise StoreUnavailable(f"version {version} of map {map_id} is collected again and again")
        activated = log.append(
            Event.ACTIVATED,
            version,
            build_id=build_id,
            needed=lambda state: (
                version in state.published and version != state.active and not done(Event.ACTIVATED, state)
            ),
        )
        if published is not None or activated is not None:
            self._note(map_id)
        return version

    def activate(self, map_id: str, version: str) -> None:
        """Serves a published version from now on: back or forward.

        Raises:
            NotFound: the map has no such version, or it was retired.
            CorruptVersion, IncompatibleVersion: its manifest cannot be used.
        """
        self.manifest(map_id, version)

        def needed(state: MapState) -> bool:
            if version not in state.published:
                raise NotFound(f"map {map_id} has no version {version}")
            return state.active != version

        if self._map_log(map_id).append(Event.ACTIVATED, version, needed=needed) is not None:
            self._note(map_id)

    def roll_back(self, map_id: str) -> str:
        """Serves the version that was active before the active one; doing it twice comes back.

        Returns:
            the version that is active now.

        Raises:
            NotFound: no such map.
            Conflict: no version was active before, or somebody activates another one just now.
            CorruptVersion, IncompatibleVersion: its manifest cannot be used.
        """
        before = self.state(map_id)
        if not before.exists:
            raise NotFound(f"no map {map_id}")
        if len(before.activated) < 2:
            raise Conflict(f"map {map_id} has no version that was active before")
        version = before.activated[1]
        self.manifest(map_id, version)

        def needed(state: MapState) -> bool:
            if state.activated != before.activated:
                raise Conflict(f"map {map_id} was just switched: look again")
            return True

        self._map_log(map_id).append(Event.ACTIVATED, version, needed=needed)
        self._note(map_id)
        return version

    def retire(self, map_id: str, version: str, *, force: bool = False) -> None:
        """Takes a version out of service. Its objects stay until ``collect_garbage``.

        Raises:
            NotFound: the map has no such version, or it was retired.
            Conflict: it is the active one, and not ``force``. With it the map falls back to the
                version that was active before, or has none.
        """
        check_version(version)

        def needed(state: MapState) -> bool:
            if version not in state.published:
                raise NotFound(f"map {map_id} has no version {version}")
            if version == state.active and not force:
                raise Conflict(f"version {version} of map {map_id} is active: activate another one first")
            return True

        self._map_log(map_id).append(Event.RETIRED, version, needed=needed)
        self._note(map_id)

    def collect_garbage(
        self,
        map_id: str,
        *,
        older_than_s: float = 86400.0,
        now: datetime | None = None,
        dry_run: bool = False,
    ) -> list[str]:
        """Removes what nobody can see: files of retired versions and of publishes that never ended.

        What was put, or retired, less than ``older_than_s`` ago by the store's times stays: a publish may
        be under way, or a replica may still serve it.

        Args:
            now: the store's time, if the caller knows it.

        Returns:
            the keys that were removed, or with ``dry_run`` would be.
        """
        cutoff = (now or self.store.now()) - timedelta(seconds=older_than_s)
        seen = self.state(map_id)
        return collect_versions(map_id, seen, self._map_log(map_id), self._objects, cutoff, dry_run=dry_run)

    def _published(self, map_id: str, version: str) -> VersionFolder:
        """
        Raises:
            NotFound: the map has no such version, or it was retired.
        """
        state = self.state(map_id)
        if check_version(version) not in state.published:
            raise NotFound(f"map {map_id} has no version {version}")
        return _folder(map_id, version, state)

    def _map_log(self, map_id: str) -> MapLog:
        check_map_id(map_id)
        with self._lock:
            return self._logs.get(map_id) or MapLog(self.store, log_folder(map_id))

    def _note(self, map_id: str) -> None:
        """After the entry, which is what holds: without a notice readers only see it later."""
        try:
            self.changes.note(map_id)
        except StoreError as error:
            _log.warning("no notice of the change of map %s: %s", map_id, error)

    # Sources

    def put_source(self, map_id: str, path: Path, *, build_id: str = "") -> str:
        """Keeps an uploaded file under its content's sha256, which is returned; for one build alone, if its
        id is given."""
        sha256 = sha256_of(path)
        self.store.put_file(source_key(map_id, sha256, build_id), path)
        return sha256


def log_folder(map_id: str) -> str:
    """Folder of the entries of a map's log."""
    return f"maps/{check_map_id(map_id)}/log"


class _Collected(Exception):
    """The files that a publish has put are being removed."""


def _folder(map_id: str, version: str, state: MapState) -> VersionFolder:
    return VersionFolder(map_id, version, state.generation(version))


def source_key(map_id: str, sha256: str, build_id: str = "") -> str:
    """Key of an uploaded file, or of a copy of it for one build alone."""
    own = f".{check_build_id(build_id)}" if build_id else ""
    return f"maps/{check_map_id(map_id)}/sources/{check_version(sha256)}{own}"
