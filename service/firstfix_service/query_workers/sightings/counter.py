"""Counts of what localized queries confirm or contradict, made in a thread beside the queries.

An answer never waits for its sighting: the scan is put into a short queue, and the thread counts it when the
answer has been sent. It works for a part of the time only. What finds no place in the queue is dropped.
"""

from __future__ import annotations

import logging
import threading
import time
from collections import Counter, deque
from dataclasses import dataclass, field

from firstfix.answer.localization import Localization
from firstfix.engine.changes.cells import spot_of
from firstfix.engine.changes.collector import Collector
from firstfix.engine.changes.sighting import sighting_of
from firstfix.engine.changes.tally import Tally
from firstfix.engine.localizer import Localizer
from firstfix.scan.compact import CompactScan
from firstfix.scan.scan import Scan
from firstfix.scan.sequence import ScanSequence

from ..query import ServedVersion

_log = logging.getLogger(__name__)

MIN_PROBABILITY = 0.99  # of an answer: a wrong pose would contradict the whole map around it
MAX_WAITING = 4
MAX_POINTS = 1_000_000  # of a scan that waits
BUSY_SHARE = 0.2  # of one processor, at most
_MAX_PAUSE_S = 1.0


@dataclass(frozen=True)
class Sighted:
    """Sightings since the last time.

    Attributes:
        tallies: by version.
        results: number of the chosen queries by result, as the metric has them.
    """

    tallies: dict[ServedVersion, Tally] = field(default_factory=dict)
    results: dict[str, int] = field(default_factory=dict)


@dataclass(frozen=True)
class _Waiting:
    version: ServedVersion
    localizer: Localizer
    scan: Scan | CompactScan
    answer: Localization


class SightingCounter:
    """Counts the sightings of this process. Thread-safe."""

    def __init__(self) -> None:
        self._lock = threading.Condition()
        self._counting: ServedVersion | None = None
        self._waiting: deque[_Waiting] = deque()
        self._collectors: dict[ServedVersion, Collector] = {}
        self._results: Counter[str] = Counter()
        self._wake, self._closing = threading.Event(), threading.Event()
        self._thread: threading.Thread | None = None

    def offer(self, version: ServedVersion, localizer: object, scan: object, answer: Localization) -> None:
        """Let a query be counted, if it is chosen. Never blocks and never fails."""
        T_map_sensor = answer.T_map_sensor
        if (
            T_map_sensor is None
            or answer.probability < MIN_PROBABILITY
            or not isinstance(localizer, Localizer)
        ):
            return
        last = scan.scans[-1] if isinstance(scan, ScanSequence) else scan
        if not isinstance(last, Scan | CompactScan):
            return
        with self._lock:
            collector = self._collectors.setdefault(version, Collector())
            if collector.knows(spot_of(T_map_sensor[:3, 3]), time.monotonic()):
                self._results["repeated"] += 1
            elif collector.is_full:
                self._results["full"] += 1
            elif len(self._waiting) >= MAX_WAITING or len(last.points) > MAX_POINTS:
                self._results["dropped"] += 1
            else:
                self._waiting.append(_Waiting(version, localizer, last, answer))

    def wake(self) -> None:
        """Let the thread count what waits: the answer has been sent."""
        if self._waiting:
            if self._thread is None:
                self._thread = threading.Thread(target=self._run, name="sightings", daemon=True)
                self._thread.start()
            self._wake.set()

    def unload(self, version: ServedVersion) -> None:
        """Let go of a version that is unloaded: drops what waits, and waits for a count under way."""
        with self._lock:
            kept = [waiting for waiting in self._waiting if waiting.version != version]
            self._results["dropped"] += len(self._waiting) - len(kept)
            self._waiting = deque(kept)
            self._lock.wait_for(lambda: self._counting != version)

    def take(self) -> Sighted:
        """Counts since the last call."""
        with self._lock:
            taken = {version: collector.take() for version, collector in self._collectors.items()}
            results, self._results = dict(+self._results), Counter()
        return Sighted({version: tally for version, tally in taken.items() if tally.sightings}, results)

    def close(self) -> None:
        """End the thread. What waits is dropped."""
        self._closing.set()
        self._wake.set()
        if self._thread is not None:
            self._thread.join()

    def _run(self) -> None:
        while not self._closing.is_set():
            self._wake.wait()
            self._wake.clear()
            while not self._closing.is_set():
                with self._lock:
                    if not self._waiting:
                        break
                    waiting = self._waiting.popleft()
                    self._counting = waiting.version
                begun = time.thread_time()
                self._count(waiting)
                del waiting  # it holds the version's files
                with self._lock:
                    self._counting = None
                    self._lock.notify_all()
                busy_s = time.thread_time() - begun
                self._closing.wait(min(busy_s * (1 / BUSY_SHARE - 1), _MAX_PAUSE_S))

    def _count(self, waiting: _Waiting) -> None:
        assert waiting.answer.T_map_sensor is not None
        try:
            sighting = sighting_of(
                waiting.localizer.index, waiting.scan, waiting.answer.T_map_sensor, waiting.answer.twist
            )
        except Exception:  # a defect must not end the thread
            _log.exception("a sighting could not be counted")
            with self._lock:
                self._results["failed"] += 1
            return
        with self._lock:
            collector = self._collectors.setdefault(waiting.version, Collector())
            now_s = time.monotonic()
            if collector.knows(sighting.spot, now_s):
                self._results["repeated"] += 1
            else:
                collector.add(sighting, now_s)
                self._results["counted"] += 1
