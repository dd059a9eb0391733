"""The localizers of the loaded versions, in this process."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path

from firstfix.engine.localizer import Localizer
from firstfix.errors import FirstfixError, VersionError

from .answer import EncodedAnswer
from .private_bytes import private_bytes
from .query import Query, ServedVersion, answer_query
from .sightings import SightingCounter


class Localizers:
    """Loads versions and answers queries with them. Thread-safe.

    Args:
        load: makes the localizer of a version's folder.
        sightings: counts the queries that are localized; None: nothing is counted.
    """

    def __init__(self, load: Callable[[Path], Localizer], sightings: SightingCounter | None = None) -> None:
        self._load_files = load
        self._sightings = sightings
        self._localizers: dict[ServedVersion, Localizer] = {}
        self._lock = threading.Lock()
        self._loads: dict[ServedVersion, threading.Lock] = {}

    @property
    def loaded(self) -> tuple[ServedVersion, ...]:
        """The versions in memory, in the order in which they were loaded."""
        with self._lock:
            return tuple(self._localizers)

    def load(self, version: ServedVersion) -> int:
        """Loads a version; returns its bytes in memory, without the mapped files."""
        localizer = self._localizer(version)
        # FAISS reads its file into memory, which ``private_bytes`` cannot see.
        held_by_faiss = sum(path.stat().st_size for path in version.directory.glob("*.faiss"))
        return private_bytes(localizer) + held_by_faiss

    def drop(self, version: ServedVersion) -> None:
        """Unloads a version."""
        with self._lock:
            self._localizers.pop(version, None)
            self._loads.pop(version, None)
        if self._sightings is not None:
            self._sightings.unload(version)

    def answer(self, query: Query) -> EncodedAnswer:
        """Returns the answer to a query. Loads its versions if they are not loaded."""
        offer = None if self._sightings is None else self._sightings.offer
        return answer_query(query, [self._localizer(version) for version in query.versions], offer)

    def clear(self) -> None:
        """Unloads all versions."""
        with self._lock:
            self._localizers.clear()

    def _localizer(self, version: ServedVersion) -> Localizer:
        with self._lock:
            if version in self._localizers:
                return self._localizers[version]
            load_lock = self._loads.setdefault(version, threading.Lock())
        with load_lock:  # other threads wait for this load instead of repeating it
            with self._lock:
                if version in self._localizers:
                    return self._localizers[version]
            try:
                localizer = self._load_files(version.directory)
            except FirstfixError:
                raise
            except Exception as error:  # of any kind: the previous version must go on serving
                raise VersionError(f"version {version.version} cannot be loaded: {error!r}") from error
            with self._lock:
                self._localizers[version] = localizer
            return localizer
