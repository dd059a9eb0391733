"""The versions that a query worker has in memory."""

from __future__ import annotations

import gc
import threading
from collections.abc import Callable
from pathlib import Path
from types import BuiltinFunctionType, FunctionType, MethodType, ModuleType

import numpy as np

from firstfix.engine.deadline import Deadline
from firstfix.engine.localizer import Localizer
from firstfix.errors import FirstfixError, VersionError

from .encoded_answer import answer_query, describe_query
from .look import Answered, Asked, Look
from .query import ServedVersion
from .sightings.counter import SightingCounter
from .warm_up import at_low_priority, own_queries

_NO_DATA = (type, ModuleType, FunctionType, BuiltinFunctionType, MethodType, str, bytes, int, float)


class Localizers:
    """Loads versions and answers queries with them. Thread-safe.

    Args:
        load: makes the localizer of a version's folder.
        max_decoded_bytes: largest body without its content encoding.
        sightings: counts the queries that are localized; None: nothing is counted.
    """

    def __init__(
        self,
        load: Callable[[Path], Localizer],
        max_decoded_bytes: int,
        sightings: SightingCounter | None = None,
    ) -> None:
        self._load_files = load
        self._max_decoded_bytes = max_decoded_bytes
        self._sightings = sightings
        self._localizers: dict[ServedVersion, Localizer] = {}
        self._lock = threading.Lock()
        self._loads: dict[ServedVersion, threading.Lock] = {}
        self._warm: set[ServedVersion] = set()

    @property
    def loaded(self) -> tuple[ServedVersion, ...]:
        """The versions in memory, in the order in which they were loaded."""
        with self._lock:
            return tuple(self._localizers)

    def load(self, version: ServedVersion) -> int:
        """Load a version; returns its bytes in memory, without the mapped files."""
        localizer = self._localizer(version)
        # FAISS reads its file into memory, which ``_private_bytes`` cannot see.
        held_by_faiss = sum(path.stat().st_size for path in version.directory.glob("*.faiss"))
        return _private_bytes(localizer) + held_by_faiss

    def warm_up(self, version: ServedVersion) -> int:
        """Ask a version about scans of its own map, once if it is loaded; returns their number.

        Raises:
            Exception: a query failed.
        """
        with self._lock:
            localizer = self._localizers.get(version)  # None: it was dropped meanwhile
        if version in self._warm or not isinstance(localizer, Localizer):
            return 0

        def ask_all() -> int:
            count = 0
            for query in own_queries(version, localizer.index):
                answer_query(query, [localizer], self._max_decoded_bytes, Deadline(query.deadline))
                count += 1
            return count

        count = at_low_priority(ask_all)
        self._warm.add(version)
        return count

    def drop(self, version: ServedVersion) -> None:
        """Unload a version."""
        self._warm.discard(version)
        with self._lock:
            self._localizers.pop(version, None)
            self._loads.pop(version, None)
        if self._sightings is not None:
            self._sightings.unload(version)

    def answer(self, asked: Asked, deadline: Deadline) -> Answered:
        """The answer to a query, its description, or a look. Loads the versions of a query.

        Raises:
            QueryCancelled: the deadline was cancelled.
        """
        deadline.check_wanted()
        if isinstance(asked, Look):
            return asked.answer(self._max_decoded_bytes)
        if asked.forms:
            return describe_query(asked, self._max_decoded_bytes)
        offer = None if self._sightings is None else self._sightings.offer
        localizers = [self._localizer(version) for version in asked.versions]
        return answer_query(asked, localizers, self._max_decoded_bytes, deadline, offer)

    def clear(self) -> None:
        """Unload all versions."""
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


def _private_bytes(root: object) -> int:
    """The bytes of all NumPy arrays reachable from an object, except arrays mapped from files.

    The pages of a mapped file are shared, and the kernel can drop them at any time.
    """
    seen: set[int] = set()
    waiting: list[object] = [root]
    total = 0
    while waiting:
        one = waiting.pop()
        if id(one) in seen or isinstance(one, _NO_DATA):
            continue
        seen.add(id(one))
        if isinstance(one, np.ndarray):
            if isinstance(one.base, np.ndarray):
                waiting.append(one.base)
            elif one.base is None:
                total += one.nbytes
        else:
            waiting.extend(gc.get_referents(one))
    return total
