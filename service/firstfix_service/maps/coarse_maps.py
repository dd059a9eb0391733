"""Keeps the coarse index in step with the maps, and chooses the maps of a query that names none."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import NamedTuple

import structlog

from firstfix.catalog.catalog import Catalog
from firstfix.engine.map_choice.coarse_index import CoarseIndex
from firstfix.engine.map_choice.coarse_templates import CoarseTemplates
from firstfix.engine.map_choice.sought_scan import SoughtScan
from firstfix.errors import FirstfixError, Overloaded, StoreError, TooLarge

from ..query_workers.query import CHOSEN_MAPS, MAX_MAPS
from ..telemetry.metrics import Metrics

_log = structlog.get_logger(__name__)
MAX_FILE_BYTES = 256 << 20  # of templates, read at once: a map with more is searched in full
READERS = 8
MAX_AT_ONCE = 256  # maps that are read before they come into the index: a quarter of a gigabyte
AGAIN_S = 60.0  # until a version that could not be read is read again
STORE_AGAIN_S = 5.0  # the same if the store failed


class _Refusal(NamedTuple):
    """Why the templates of a version are not in the index.

    Attributes:
        again_at: ``time.monotonic`` from which on they are read again.
    """

    version: str
    error: FirstfixError
    again_at: float


class CoarseMaps:
    """Templates of the active version of every map. Thread-safe.

    A thread reads them, as soon as there are more maps than one query searches. Nobody waits for it.

    Args:
        directory: of the index's files.
    """

    def __init__(self, catalog: Catalog, directory: Path, metrics: Metrics) -> None:
        self._catalog = catalog
        self._directory = directory
        self._metrics = metrics
        self._changed = threading.Condition()
        self._stopped = False
        self._active: dict[str, str] = {}  # map to version
        self._held: dict[str, str] = {}  # the same, of those in the index
        self._refused: dict[str, _Refusal] = {}
        self._index: CoarseIndex | None = None
        self._thread = threading.Thread(target=self._run, name="coarse-maps", daemon=True)

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def close(self) -> None:
        """Stop the thread and waits until it has ended."""
        with self._changed:
            self._stopped = True
            self._changed.notify_all()
        self._thread.join()

    def follow(self, active: Mapping[str, str | None]) -> None:
        """Take over what a poll has read: active versions of some maps; None: the map has none."""
        with self._changed:
            before = dict(self._active)
            for map_id, version in active.items():
                if version is None:
                    self._active.pop(map_id, None)
                else:
                    self._active[map_id] = version
            if self._active != before:
                self._changed.notify_all()

    @property
    def forms(self) -> tuple[str, ...]:
        """Forms in which a scan must be described for ``choose``."""
        return () if self._index is None else self._index.forms

    def choose(self, scan: SoughtScan, visible: Iterable[str]) -> tuple[str, ...]:
        """The maps to search: those that resemble the scan most, and a few that are not read yet.

        Blocks for some milliseconds.

        Args:
            visible: the maps that the caller sees. The others change nothing.

        Raises:
            Overloaded: too many of the maps are not read yet, since the service has just started.
        """
        seen, index = frozenset(visible), self._index
        with self._changed:
            without = {map_id: self._refused.get(map_id) for map_id in sorted(seen - self._held.keys())}
        unread = [name for name, no in without.items() if no is None or isinstance(no.error, StoreError)]
        # A damaged version cannot answer either, so it is no map to search.
        too_large = [name for name, no in without.items() if no and isinstance(no.error, TooLarge)]
        if len(unread) > CHOSEN_MAPS:
            raise Overloaded(
                f"the templates of {len(unread)} of {len(seen)} maps are still being read: "
                "try again, or name the maps",
                retry_after_s=STORE_AGAIN_S,
            )
        best = () if index is None else index.best(scan, seen.__contains__, CHOSEN_MAPS)
        others = [*unread, *too_large][: MAX_MAPS - CHOSEN_MAPS]
        return tuple(dict.fromkeys([*best, *others]))

    def _run(self) -> None:
        while True:
            with self._changed:
                due = self._due()
                while not (self._stopped or due[0] or due[1]):
                    self._changed.wait(STORE_AGAIN_S)
                    due = self._due()
                if self._stopped:
                    return
                expected = len(self._active)
            try:
                self._update(*due, expected)
            except Exception:  # a defect must not end the thread: without it no new map would be found
                _log.exception("the coarse index could not be changed")
                with self._changed:
                    self._changed.wait(STORE_AGAIN_S)

    def _due(self) -> tuple[dict[str, str], list[str]]:
        """Map to read, with their versions, and maps that have gone. Under the lock."""
        now = time.monotonic()
        if len(self._active) <= MAX_MAPS:  # all of them are searched
            self._refused.clear()
            return {}, list(self._held)
        gone = [map_id for map_id in self._held if map_id not in self._active]
        due = {}
        for map_id, version in self._active.items():
            refusal = self._refused.get(map_id)
            is_refused = refusal is not None and refusal.version == version and now < refusal.again_at
            if self._held.get(map_id) != version and not is_refused:
                due[map_id] = version
                if len(due) >= min(MAX_AT_ONCE, max(MAX_MAPS, len(self._held))):
                    break
        return due, gone

    def _update(self, due: Mapping[str, str], gone: list[str], expected: int) -> None:
        with ThreadPoolExecutor(READERS, thread_name_prefix="coarse-reader") as readers:
            read = readers.map(self._read, due, due.values())
            found = {map_id: one for map_id, one in zip(due, read, strict=True) if one is not None}
        if found or gone:
            if self._index is None:
                self._directory.mkdir(parents=True, exist_ok=True)
                self._index = CoarseIndex(self._directory)
            self._index.change(found, gone, expected)
        with self._changed:
            self._held = {map_id: version for map_id, version in self._held.items() if map_id not in gone}
            self._held |= {map_id: due[map_id] for map_id in found}
            for map_id in [*found, *gone]:
                self._refused.pop(map_id, None)
            self._metrics.coarse_maps.set(len(self._held))

    def _read(self, map_id: str, version: str) -> CoarseTemplates | None:
        """The templates of a version; None if they cannot be read now."""
        read = partial(self._catalog.read_file, map_id, version, max_bytes=MAX_FILE_BYTES)
        try:
            return CoarseTemplates.read(read)
        except FirstfixError as error:
            _log.warning("not in the coarse index", map_id=map_id, code=error.code, error=str(error))
            wait_s = STORE_AGAIN_S if isinstance(error, StoreError) else AGAIN_S
            with self._changed:
                self._refused[map_id] = _Refusal(version, error, time.monotonic() + wait_s)
            return None
