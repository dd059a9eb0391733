"""Maps, their versions and builds in an object store.

    maps/<map_id>/sources/...                       see ``firstfix.catalog.sources``
    maps/<map_id>/versions/<digest>/...             files of a version: ``firstfix.catalog.versions.objects``
    maps/<map_id>/versions/<digest>/manifest.json   written last
    maps/<map_id>/versions/<digest>/sightings/...   see ``firstfix.catalog.sightings.sightings``
    maps/<map_id>/log/000001.json, ...              see ``firstfix.catalog.log.map_log``
    maps/<map_id>/snapshots/000050.json, ...        see ``firstfix.catalog.log.map_log``
    changes/00000001.json, ...                      see ``firstfix.catalog.log.change_log``
    builds/<build_id>/...                           see ``firstfix.builds.records``

A version without a manifest does not exist. A version without a ``published`` entry in the map's log is not
visible. So a publication that dies at any point has either published or not, and can be repeated.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

from ..builds.config import ActivateConfig, PatchMode
from ..builds.records import BuildRecords
from ..errors import CorruptVersion, InvalidOption, NotFound, StoreError, VersionError
from ..findings.finding import Finding
from ..ids import check_map_id, check_version, is_name
from ..store.store import Store
from . import activation
from .hold_back import reason_to_hold
from .log.change_log import ChangeLog
from .log.map_log import MapLog
from .log.map_state import Event, LogEntry, MapState
from .manifest import Manifest
from .provenance import UNKNOWN, Provenance
from .publish import publish_and_activate
from .version_prefix import full_version
from .versions.garbage import collect_versions
from .versions.objects import VersionFolder, VersionObjects

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class VersionInfo:
    """One version of a map that can be served.

    Attributes:
        published_time: UTC, ISO 8601.
        provisional: coarse and little tested, until the full version takes its place.
        provenance: what it was made of, and by whom.
        summary: its numbers, as ``summary_of`` gives them; empty: they were not recorded.
    """

    version: str
    active: bool
    published_time: str
    provisional: bool = False
    provenance: Provenance = UNKNOWN
    summary: Mapping[str, Any] = field(default_factory=dict, hash=False)


class Catalog:
    """Maps and builds that the builder writes and the service reads. Thread-safe.

    Every method raises InvalidOption for an invalid id or version, and StoreUnavailable or StoreError if the
    store fails.

    Attributes:
        builds: requests and states of the builds.
        changes: notices of changed maps.
    """

    def __init__(self, store: Store) -> None:
        self.store = store
        self.builds = BuildRecords(store)
        self.changes = ChangeLog(store)
        self._logs: dict[str, MapLog] = {}  # of existing maps only: made-up ids leave no trace
        self._objects = VersionObjects(store)
        self._lock = threading.Lock()

    # Reading

    def map_ids(self) -> list[str]:
        """Ids of the maps that have a version to serve."""
        return [name for name in self.folder_names() if self.state(name).published]

    def folder_names(self) -> list[str]:
        """Ids of all maps with anything in the store, with or without a version. One listing."""
        return [name for name in self.store.folders("maps") if is_name(name)]

    def state(self, map_id: str) -> MapState:
        """Current state of a map, summed up from its log. Empty for a map that does not exist."""
        log = self._map_log(map_id)
        state = log.state()
        with self._lock:
            if state.last_seq:
                self._logs.setdefault(map_id, log)
        return state

    def known_state(self, map_id: str) -> MapState:
        """State of a map when it was last read. Sends no request to the store."""
        return self._map_log(map_id).known_state()

    def log(self, map_id: str) -> list[LogEntry]:
        """Newest entries of the map's log, and the older ones that still matter (``MapState.entries``)."""
        return list(self.state(map_id).entries)

    def active_version(self, map_id: str) -> str | None:
        """Version that the map serves; None if it has none."""
        return self.state(map_id).active

    def versions(self, map_id: str) -> list[VersionInfo]:
        """Versions that can be served, newest first.

        Raises:
            NotFound: the map never had a version.
        """
        state = self.state(map_id)
        if not state.exists:
            raise NotFound.of_map(map_id)
        infos = (version_info(state, version) for version in reversed(state.published))
        return [one for one in infos if self._objects.exists(_folder(map_id, one.version, state))]

    def full_version(self, map_id: str, given: str) -> str:
        """The version of a map that begins with the given characters. A whole version is not looked up.

        Raises:
            InvalidOption: not 4 to 64 hex characters, or several versions of the map begin so.
            NotFound: no such map, or no version of it begins so.
        """
        return full_version(given, self._published(map_id))

    def _published(self, map_id: str) -> Iterator[str]:
        """Yield the versions that can be served; the store is asked as the first one is wanted."""
        state = self.state(map_id)
        if not state.exists:
            raise NotFound.of_map(map_id)
        yield from state.published

    def manifest(self, map_id: str, version: str) -> Manifest:
        """Read the manifest of a version.

        Raises:
            NotFound: the map has no such version, or it was retired.
            CorruptVersion: the manifest is missing, or its digest is not the version.
            IncompatibleVersion: this release does not read its format.
        """
        return self._objects.manifest(self.folder_of(map_id, version))

    def fetch_version(self, map_id: str, version: str, directory: Path) -> Path:
        """Fetch a version's files but those for viewers, and verify each. Safe to call concurrently.

        Returns:
            The local folder with the files: in the cache directory, or in the store itself if that is a
            directory.

        Raises:
            NotFound, IncompatibleVersion: see ``manifest``.
            CorruptVersion: see ``manifest``; or a file is missing or differs.
        """
        return self._objects.fetch(self.folder_of(map_id, version), directory)

    def read_file(self, map_id: str, version: str, name: str, *, max_bytes: int) -> bytes:
        """Read one file of a version, verified by its sha256: with one request, once the version is known.

        A version that was just retired may still be read.

        Raises:
            NotFound: the version has no such file; or see ``manifest``.
            TooLarge: the file has more than ``max_bytes``.
            CorruptVersion: see ``manifest``; or the file is missing or differs.
        """
        state = self.known_state(map_id)
        if check_version(version) in state.published:
            with suppress(NotFound, CorruptVersion):  # it may have been retired, and published again, since
                folder = _folder(map_id, version, state)
                return self._objects.read_file(folder, name, max_bytes=max_bytes)
        return self._objects.read_file(self.folder_of(map_id, version), name, max_bytes=max_bytes)

    def read_part(self, map_id: str, version: str, name: str, start: int, length: int) -> bytes:
        """Read part of one file of a version: with one request to the store, once the version is known.

        A part cannot be verified by the file's sha256. A version that was just retired may still be read.

        Raises:
            NotFound: the version has no such file; or see ``manifest``.
            InvalidOption: the part is not within the file.
        """
        state = self.known_state(map_id)
        if check_version(version) in state.published:
            with suppress(NotFound, CorruptVersion):  # it may have been retired, and published again, since
                return self._part(_folder(map_id, version, state), name, start, length)
        return self._part(self.folder_of(map_id, version), name, start, length)

    def _part(self, folder: VersionFolder, name: str, start: int, length: int) -> bytes:
        entry = self._objects.manifest(folder).files.get(name)
        if entry is None:
            raise NotFound(f"version {folder.version} of map {folder.map_id} has no {name}")
        if start + length > entry.bytes:
            raise InvalidOption(f"{name} has {entry.bytes} bytes, not {length} from {start} on")
        return self.store.get_range(f"{folder.key}/{name}", start, length, size=entry.bytes)

    def folder_of(self, map_id: str, version: str) -> VersionFolder:
        """Folder of a published version.

        Raises:
            NotFound: the map has no such version, or it was retired.
        """
        state = self.state(map_id)
        activation.check_published(map_id, check_version(version), state)
        return _folder(map_id, version, state)

    # Writing

    def reason_to_hold(
        self, map_id: str, manifest: Manifest, config: ActivateConfig, patch: PatchMode = "propose"
    ) -> Finding | None:
        """Finding because of which a version is to be published and not activated; None: there is none.

        It is compared with the active version. That one has no reason: a repetition changes nothing.

        Args:
            patch: what becomes of the version if it is patched.
        """
        version = self.active_version(map_id)
        if version == manifest.digest:
            return None
        active = None
        if version is not None:
            with suppress(
                NotFound, VersionError
            ):  # retired meanwhile, or it cannot be served: nothing to lose
                active = self.manifest(map_id, version)
        return reason_to_hold(map_id, manifest, active, config, patch)

    def publish(
        self,
        map_id: str,
        directory: Path,
        manifest: Manifest,
        *,
        activate: bool = True,
        build_id: str = "",
        provenance: Provenance = UNKNOWN,
        on_progress: Callable[[float], None] = lambda done: None,
    ) -> str:
        """Put a version's files and its manifest, record the publication in the log, and activate it.

        A provisional version does nothing where the map has a full one, and is retired when it gets one, also
        if that one is not activated: the same map has failed its test.

        With a build id each log entry is written once for that build, so that a repetition does not undo what
        somebody did in between.

        Args:
            activate: False: publish it only (``reason_to_hold``).
            provenance: is recorded where the version is new.
            on_progress: called as the files are put with the share that is done, 0..1.

        Returns:
            The version's digest.

        Raises:
            CorruptVersion: a file in the directory differs from the manifest.
        """
        log = self._map_log(map_id)
        if publish_and_activate(
            map_id,
            log,
            self._objects,
            directory,
            manifest,
            activate=activate,
            build_id=build_id,
            provenance=provenance,
            on_progress=on_progress,
        ):
            self._note_change(map_id)
        return manifest.digest

    def activate(self, map_id: str, version: str) -> None:
        """Serve a published version, older or newer, from now on.

        Raises:
            NotFound: the map has no such version, or it was retired.
            CorruptVersion, IncompatibleVersion: its manifest cannot be used.
        """
        self.manifest(map_id, version)
        if activation.activate(map_id, self._map_log(map_id), version):
            self._note_change(map_id)

    def roll_back(self, map_id: str) -> str:
        """Serve the version that was active before the active one. A second call undoes the first.

        Returns:
            The version that is active now.

        Raises:
            NotFound: no such map.
            Conflict: no version was active before, or another one was activated meanwhile.
            CorruptVersion, IncompatibleVersion: its manifest cannot be used.
        """
        before = self.state(map_id)
        version = activation.version_before(map_id, before)
        self.manifest(map_id, version)
        activation.roll_back(map_id, self._map_log(map_id), before)
        self._note_change(map_id)
        return version

    def retire(self, map_id: str, version: str, *, force: bool = False) -> None:
        """Take a version out of service. Its objects stay until ``collect_garbage``.

        Raises:
            NotFound: the map has no such version, or it was retired.
            Conflict: it is the active one, and not ``force``. With ``force`` the map serves the version that
                was active before, or none.
        """
        activation.retire(map_id, self._map_log(map_id), check_version(version), force=force)
        self._note_change(map_id)

    def remove_map(self, map_id: str) -> list[str]:
        """Take all versions of a map out of service. Their objects stay until ``collect_garbage``.

        A version that is published meanwhile stays.

        Returns:
            The versions that were retired.

        Raises:
            NotFound: the map has no version.
        """
        state = self.state(map_id)
        if not state.published:
            raise NotFound.of_map(map_id)
        for version in sorted(state.published, key=lambda one: one == state.active):  # the active one last
            with suppress(NotFound):  # somebody else has just retired it
                activation.retire(map_id, self._map_log(map_id), version, force=True)
        self._note_change(map_id)
        return list(state.published)

    def collect_garbage(
        self,
        map_id: str,
        *,
        older_than_s: float = 86400.0,
        now: datetime | None = None,
        dry_run: bool = False,
    ) -> list[str]:
        """Remove the files of retired versions and of publications that never ended.

        Anything put or retired less than ``older_than_s`` ago by the store's clock stays: a publication may
        be in progress, or a replica may still serve the version.

        Args:
            now: the store's time, if the caller knows it.

        Returns:
            The removed keys, or with ``dry_run`` those that would be removed.
        """
        cutoff = (now or self.store.now()) - timedelta(seconds=older_than_s)
        seen = self.state(map_id)
        return collect_versions(map_id, seen, self._map_log(map_id), self._objects, cutoff, dry_run=dry_run)

    def _map_log(self, map_id: str) -> MapLog:
        check_map_id(map_id)
        with self._lock:
            return self._logs.get(map_id) or MapLog(self.store, log_folder(map_id))

    def _note_change(self, map_id: str) -> None:
        """Put a notice of the change. Without it readers only see the log's new entry later."""
        try:
            self.changes.note(map_id)
        except StoreError as error:
            _log.warning("no notice of the change of map %s: %s", map_id, error)


def version_info(state: MapState, version: str) -> VersionInfo:
    """Record of a published version in the log of its map.

    Raises:
        NotFound: the version is not published.
    """
    published = (e for e in reversed(state.entries) if (e.event, e.version) == (Event.PUBLISHED, version))
    entry = next(published, None)
    if entry is None or version not in state.published:
        raise NotFound(f"no version {version}")
    provenance = Provenance.from_mapping(entry.provenance)
    is_active, is_provisional = version == state.active, version in state.provisional
    return VersionInfo(version, is_active, entry.time, is_provisional, provenance, entry.summary)


def log_folder(map_id: str) -> str:
    """Folder of the entries of a map's log."""
    return f"maps/{check_map_id(map_id)}/log"


def _folder(map_id: str, version: str, state: MapState) -> VersionFolder:
    return VersionFolder(map_id, version, state.generation(version))
