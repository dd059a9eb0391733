"""A map's localizer in this process, for robots that must not depend on a network.

The files of versions are in the cache of ``localize --store`` (``firstfix.catalog.versions.cache``).
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from firstfix.answer.localization import Localization
from firstfix.answer.options import LocalizeOptions
from firstfix.catalog.catalog import Catalog
from firstfix.catalog.manifest import Manifest
from firstfix.catalog.version_prefix import check_prefix
from firstfix.catalog.versions.cache import cached_version
from firstfix.catalog.versions.folder_lock import FolderLock
from firstfix.catalog.versions.last_served import LastServed
from firstfix.catalog.versions.prune import prune
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer
from firstfix.errors import FirstfixError, InvalidOption, NotFound, StoreError, StoreUnavailable, VersionError
from firstfix.scan.sequence import AnyScan

MAX_DISK_BYTES = 16 << 30  # of the cache; the version that answers stays in any case
UPDATE_EVERY_S = 10.0
_REFUSED_FOR_S = 60.0  # then a version that could not be loaded is tried again: it may have been repaired


@dataclass(frozen=True)
class _Answering:
    """A loaded version.

    Attributes:
        folder_lock: keeps a fetched folder on the disk; None for a version in a file store.
    """

    manifest: Manifest
    version: str
    localizer: Localizer
    folder_lock: FolderLock | None


class EmbeddedLocalizer:
    """Answers with the active version of one map, and follows it in the background. Thread-safe.

    A new version is fetched and loaded beside the old one, then takes its place: no query waits. While the
    store does not answer, the version that is loaded goes on answering. At the start this is the one that
    answered last, if it is in the cache. A version that cannot be loaded is left out, and the one that was
    active before answers, as in the service.

    Args:
        directory: cache of versions on the disk.
        last: which version answered last.
        log_line: called with a line about each change, in any thread.
    """

    def __init__(
        self,
        catalog: Catalog,
        map_id: str,
        directory: Path,
        last: LastServed,
        *,
        update_every_s: float = UPDATE_EVERY_S,
        max_disk_bytes: int = MAX_DISK_BYTES,
        log_line: Callable[[str], None] = lambda line: None,
    ) -> None:
        self._catalog, self._map_id, self._directory, self._last = catalog, map_id, directory, last
        self._update_every_s, self._max_disk_bytes, self._log_line = update_every_s, max_disk_bytes, log_line
        self._answering: _Answering | None = None
        self._was_removed = False
        self._refused_until: dict[str, float] = {}
        self._last_line = ""
        self._updating = threading.Lock()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._follow, name="map-update", daemon=True)

    @property
    def version(self) -> str | None:
        """Digest of the version that answers; None before one is loaded."""
        answering = self._answering
        return None if answering is None else answering.version

    def start(self) -> None:
        """Load a version and begin to follow the map. Returns without one while the store does not answer.

        A version in the cache is loaded without a request to the store.

        Raises:
            NotFound: there is no version in the cache, and the store has none.
            VersionError: no version can be loaded.
        """
        self._load_last()
        if self._answering is None:
            try:
                self.update()
            except StoreError as error:
                self._log_once(f"no map yet, the store is asked again: {error}")
        self._thread.start()

    def close(self) -> None:
        """End the thread. A request to the store that does not answer is left alone."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join(timeout=1.0)
        if not self._thread.is_alive():
            self._replace(None)

    def __call__(self, scan: AnyScan, options: LocalizeOptions) -> Localization:
        """The answer.

        Raises:
            StoreUnavailable: no version is loaded, because the store did not answer yet.
            NotFound: the map has no active version any more.
            InvalidOption: the options name another version than the active one.
            InputError: the scan or an option cannot be used.
        """
        answering = self._answering
        if answering is None:
            if self._was_removed:
                raise NotFound(f"map {self._map_id} has no active version")
            raise StoreUnavailable(f"no version of map {self._map_id} was fetched yet")
        if not answering.version.startswith(check_prefix(options.version or answering.version)):
            raise InvalidOption(f"only the active version answers here, {answering.version}")
        found = answering.localizer.localize(scan, options)
        provisional = answering.manifest.provisional
        return found.of_version(self._map_id, answering.version, provisional=provisional)

    def update(self) -> bool:
        """Look at the store once, and load the active version if another one answers.

        Returns:
            Whether another version answers now.

        Raises:
            NotFound: the map has no active version. Nothing answers then, as in the service.
            VersionError: no version can be loaded.
            StoreError: the store failed; the version that is loaded goes on answering.
        """
        with self._updating:
            state = self._catalog.state(self._map_id)
            if not state.activated:
                self._was_removed = True
                self._last.forget()
                self._replace(None)
                raise NotFound(f"map {self._map_id} has no active version")
            first_error: VersionError | None = None
            for version in state.activated:
                if version == self.version:
                    return False
                if time.monotonic() < self._refused_until.get(version, 0.0):
                    continue
                try:
                    loaded = self._fetch_and_load(version)
                except VersionError as error:
                    self._refused_until[version] = time.monotonic() + _REFUSED_FOR_S
                    self._log_line(f"version {version[:12]} cannot be used: {error}")
                    first_error = first_error or error
                    continue
                self._replace(loaded)
                self._remember(loaded.manifest)
                self._log_line(f"version {version[:12]} of map {self._map_id} answers")
                prune(self._directory, self._max_disk_bytes)
                return True
            if first_error is not None and self._answering is None:
                raise first_error
            return False

    def _follow(self) -> None:
        while not self._stop.is_set():
            try:
                self.update()
                self._last_line = ""
            except FirstfixError as error:
                self._log_once(str(error))
            except Exception as error:  # without this thread no new version would come
                self._log_once(repr(error))
            self._stop.wait(self._update_every_s)

    def _log_once(self, line: str) -> None:
        """Log a line unless it was the last one: a network may be gone for days."""
        if line != self._last_line:
            self._last_line = line
            self._log_line(line)

    def _load_last(self) -> None:
        manifest = self._last.read()
        if manifest is None:
            return
        with suppress(VersionError, FileNotFoundError):
            folder = cached_version(manifest, self._directory)
            if folder is not None:
                self._answering = self._loaded(manifest, folder)
                self._log_line(
                    f"version {manifest.digest[:12]} of map {self._map_id} answers, from the cache"
                )

    def _fetch_and_load(self, version: str) -> _Answering:
        manifest = self._catalog.manifest(self._map_id, version)
        while True:
            folder = self._catalog.fetch_version(self._map_id, version, self._directory)
            try:
                return self._loaded(manifest, folder)
            except FileNotFoundError:  # another process has just pruned it
                continue

    def _loaded(self, manifest: Manifest, folder: Path) -> _Answering:
        """Load a folder.

        Raises:
            FileNotFoundError: it was pruned before it was locked.
            VersionError: it cannot be loaded.
        """
        lock = FolderLock(folder) if folder.parent == self._directory else None
        try:
            localizer = Localizer(MapIndex.load(folder))
        except BaseException as error:
            if lock is not None:
                lock.close()
            if isinstance(error, FirstfixError) or not isinstance(error, Exception):
                raise
            raise VersionError(f"version {manifest.digest} cannot be loaded: {error!r}") from error
        return _Answering(manifest, manifest.digest, localizer, lock)

    def _remember(self, manifest: Manifest) -> None:
        try:
            self._last.write(manifest)
        except OSError as error:
            self._log_line(f"the next start needs the store, the version cannot be noted: {error}")

    def _replace(self, new: _Answering | None) -> None:
        old, self._answering = self._answering, new
        if old is not None and old.folder_lock is not None:
            old.folder_lock.close()  # queries that still use the old version have its files mapped
