"""Where queries are worked out: in this process, or in processes of their own (``process_workers``)."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path
from typing import Protocol

from firstfix.answer.localization import Localization
from firstfix.errors import FirstfixError, VersionError

from .private_bytes import private_bytes
from .query import LocalizesScans, Query, ServedVersion, answer_query


class Workers(Protocol):
    """Thread-safe. Who calls says what is loaded; a version that a query names is loaded if it is not."""

    def load(self, version: ServedVersion) -> int:
        """Makes every worker ready to answer from a version; returns the bytes that it takes besides its
        mapped files, of all workers together.

        Raises:
            VersionError: it cannot be loaded.
        """
        ...

    def drop(self, version: ServedVersion) -> None:
        """Forgets a version that no query is under way for."""
        ...

    def answer(self, query: Query) -> Localization:
        """
        Raises:
            InputError: the body or an option cannot be used.
            VersionError: a version cannot be loaded.
            WorkerLost, DeadlineExceeded: the process that had it died, twice, or took too long.
        """
        ...

    def close(self) -> None: ...


class LocalWorkers:
    """In this process, by the threads that call."""

    def __init__(self, load: Callable[[Path], LocalizesScans]) -> None:
        self._load_files = load
        self._localizers: dict[ServedVersion, LocalizesScans] = {}
        self._lock = threading.Lock()
        self._loads: dict[ServedVersion, threading.Lock] = {}

    def load(self, version: ServedVersion) -> int:
        localizer = self._localizer(version)
        # What FAISS holds cannot be seen from here: it reads its file into memory.
        held_by_faiss = sum(path.stat().st_size for path in version.directory.glob("*.faiss"))
        return private_bytes(localizer) + held_by_faiss

    def drop(self, version: ServedVersion) -> None:
        with self._lock:
            self._localizers.pop(version, None)
            self._loads.pop(version, None)

    def answer(self, query: Query) -> Localization:
        return answer_query(query, [self._localizer(version) for version in query.versions])

    def close(self) -> None:
        with self._lock:
            self._localizers.clear()

    def _localizer(self, version: ServedVersion) -> LocalizesScans:
        with self._lock:
            if version in self._localizers:
                return self._localizers[version]
            load_lock = self._loads.setdefault(version, threading.Lock())
        with load_lock:  # whoever else wants it waits for this load instead of doing it again
            with self._lock:
                if version in self._localizers:
                    return self._localizers[version]
            try:
                localizer = self._load_files(version.directory)
            except FirstfixError:
                raise
            except Exception as error:  # whatever it is, the version before must go on serving
                raise VersionError(f"version {version.version} cannot be loaded: {error!r}") from error
            with self._lock:
                self._localizers[version] = localizer
            return localizer
