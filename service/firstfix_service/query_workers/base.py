"""Workers that answer queries: threads of this process, or processes (``query_workers.pool``)."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path
from typing import Protocol

from firstfix.answer.localization import Localization
from firstfix.engine.localizer import Localizer
from firstfix.errors import FirstfixError, VersionError

from .private_bytes import private_bytes
from .query import Query, ServedVersion, answer_query


class QueryWorkers(Protocol):
    """Workers that answer queries. Thread-safe.

    The caller decides which versions are loaded. A query loads its versions if they are not.
    """

    def load(self, version: ServedVersion) -> int:
        """Loads a version in every worker.

        Returns:
            Bytes of memory of all workers together, without the mapped files.

        Raises:
            VersionError: the version cannot be loaded.
        """
        ...

    def drop(self, version: ServedVersion) -> None:
        """Unloads a version that no query uses."""
        ...

    def answer(self, query: Query) -> Localization:
        """Returns the answer to a query.

        Raises:
            InputError: the body or an option cannot be used.
            VersionError: a version cannot be loaded.
            WorkerLost: two processes died over the query.
            DeadlineExceeded: the query took too long.
        """
        ...

    def close(self) -> None:
        """Ends the workers. Call it when no query runs."""
        ...


class QueryWorkerThreads:
    """Workers without processes: the calling thread answers."""

    def __init__(self, load: Callable[[Path], Localizer]) -> None:
        self._load_files = load
        self._localizers: dict[ServedVersion, Localizer] = {}
        self._lock = threading.Lock()
        self._loads: dict[ServedVersion, threading.Lock] = {}

    def load(self, version: ServedVersion) -> int:
        """Loads a version; returns its bytes in memory."""
        localizer = self._localizer(version)
        # FAISS reads its file into memory, which ``private_bytes`` cannot see.
        held_by_faiss = sum(path.stat().st_size for path in version.directory.glob("*.faiss"))
        return private_bytes(localizer) + held_by_faiss

    def drop(self, version: ServedVersion) -> None:
        """Unloads a version."""
        with self._lock:
            self._localizers.pop(version, None)
            self._loads.pop(version, None)

    def answer(self, query: Query) -> Localization:
        """Returns the answer to a query."""
        return answer_query(query, [self._localizer(version) for version in query.versions])

    def close(self) -> None:
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
