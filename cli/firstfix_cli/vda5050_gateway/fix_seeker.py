"""Fixes of vehicles: their scans are taken and asked for, a few at a time, in threads of a pool."""

from __future__ import annotations

import queue
import time
from collections import OrderedDict
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial

import httpx

from firstfix.answer.options import LocalizeOptions
from firstfix.decode import decode_query
from firstfix.errors import FirstfixError, UnsupportedFormat
from firstfix.scan.scan import Scan
from firstfix.scan.sequence import ScanSequence
from firstfix.telemetry.redact import redact

from ..answerer import Answerer
from .fleets_file import FleetEntry
from .http_scan import MAX_SCAN_BYTES, fetch_scan
from .planar_fix import NoFix, PlanarFix, planar_fix
from .scan_address import ScanAddress
from .topics import VehicleName

AT_ONCE = 4  # scans in memory, and queries of this gateway
MOST_TOPICS = 32  # on which scans are waited for: vehicles that send none must not hold up all others
TOPIC_WAIT_S = 30.0  # for a scan on a topic
Seek = tuple[VehicleName, int]


@dataclass(frozen=True)
class Fleet:
    """A fleet of the file, with who answers its queries."""

    name: str
    entry: FleetEntry
    ask: Answerer


@dataclass(frozen=True)
class Outcome:
    """Outcome of an attempt of a vehicle."""

    vehicle: VehicleName
    attempt: int
    result: PlanarFix | NoFix


class FixSeeker:
    """Seeks fixes. All methods are for one thread; ``outcomes`` gives what the pool has done.

    Args:
        subscribe, unsubscribe: of a topic that has scans.
    """

    def __init__(
        self,
        subscribe: Callable[[str], None],
        unsubscribe: Callable[[str], None],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._subscribe, self._unsubscribe, self._clock = subscribe, unsubscribe, clock
        self._tls = httpx.create_ssl_context()
        self._pool = ThreadPoolExecutor(AT_ONCE, thread_name_prefix="asks for a vehicle")
        self._waiting: OrderedDict[Seek, Fleet] = OrderedDict()
        self._on_topic: dict[str, tuple[Seek, Fleet, float]] = {}
        self._in_pool: set[Seek] = set()
        self._done: queue.SimpleQueue[Outcome] = queue.SimpleQueue()

    def seek(self, fleet: Fleet, vehicle: VehicleName, attempt: int) -> None:
        """Begins as soon as there is room: first come, first served."""
        self._waiting[vehicle, attempt] = fleet
        self._begin()

    def drop(self, vehicle: VehicleName, attempt: int) -> None:
        """Ends what has not begun yet. What runs in the pool ends by itself."""
        self._waiting.pop((vehicle, attempt), None)
        for topic, (seek, _, _) in list(self._on_topic.items()):
            if seek == (vehicle, attempt):
                self._end_topic(topic)
        self._begin()

    def topics(self) -> list[str]:
        """Returns the topics on which scans are waited for: a new connection subscribes to them again."""
        return list(self._on_topic)

    def take_scan(self, topic: str, body: bytes) -> bool:
        """Takes a message that comes now. Returns whether it is a scan that was waited for."""
        if topic not in self._on_topic:
            return False
        if len(self._in_pool) >= AT_ONCE:  # a later scan is as good
            seek, fleet, _ = self._on_topic[topic]
            self._on_topic[topic] = seek, fleet, self._clock() + TOPIC_WAIT_S
            return True
        seek, fleet, _ = self._end_topic(topic)
        if len(body) > MAX_SCAN_BYTES:
            self._done.put(Outcome(*seek, NoFix(f"its scan has more than {MAX_SCAN_BYTES} bytes")))
        else:
            self._submit(seek, fleet, lambda: (body, fleet.entry.media_type))
        return True

    def outcomes(self) -> list[Outcome]:
        """Returns what has ended since the last call."""
        now_s = self._clock()
        for topic, (seek, _, until_s) in list(self._on_topic.items()):
            if now_s > until_s:
                self._end_topic(topic)
                self._done.put(Outcome(*seek, NoFix(f"no scan came on its topic within {TOPIC_WAIT_S:g} s")))
        found = [self._done.get() for _ in range(self._done.qsize())]
        self._in_pool -= {(one.vehicle, one.attempt) for one in found}
        self._begin()
        return found

    def close(self) -> None:
        """Ends after the running queries."""
        self._waiting.clear()
        self._pool.shutdown(cancel_futures=True)

    def _begin(self) -> None:
        while self._waiting and len(self._in_pool) < AT_ONCE and len(self._on_topic) < MOST_TOPICS:
            seek, fleet = self._waiting.popitem(last=False)
            address, vehicle = ScanAddress(fleet.entry.scan), seek[0]
            try:
                place = address.of(vehicle)
            except FirstfixError as error:
                self._done.put(Outcome(*seek, NoFix(str(error))))
                continue
            if not address.is_topic:
                self._submit(seek, fleet, partial(fetch_scan, place, fleet.entry.media_type, self._tls))
            elif place in self._on_topic:
                self._done.put(Outcome(*seek, NoFix("the topic of its scan is another vehicle's, too")))
            else:
                self._on_topic[place] = seek, fleet, self._clock() + TOPIC_WAIT_S
                self._subscribe(place)

    def _end_topic(self, topic: str) -> tuple[Seek, Fleet, float]:
        self._unsubscribe(topic)
        return self._on_topic.pop(topic)

    def _submit(self, seek: Seek, fleet: Fleet, take: Callable[[], tuple[bytes, str]]) -> None:
        self._in_pool.add(seek)

        def work() -> None:
            try:
                result = _asked(fleet, take)
            except (FirstfixError, ConnectionError) as error:
                result = NoFix(redact(str(error))[:300])
            except Exception as error:  # a defect must not leave the vehicle without an outcome
                result = NoFix(f"defect: {error!r}"[:300])
            self._done.put(Outcome(*seek, result))

        self._pool.submit(work)


def _asked(fleet: Fleet, take: Callable[[], tuple[bytes, str]]) -> PlanarFix | NoFix:
    scan = decode_query(*take())
    if not isinstance(scan, Scan | ScanSequence):
        raise UnsupportedFormat("its scan has no points: a compact query or a descriptor")
    answer = fleet.ask(scan, LocalizeOptions(T_base_sensor=fleet.entry.mounting))
    return planar_fix(answer, fleet.entry.max_tilt_deg)
