"""Fixes of vehicles: their scans are taken and asked for, a few at a time, in threads of a pool."""

from __future__ import annotations

import queue
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeGuard

import httpx

from firstfix.answer.options import LocalizeOptions
from firstfix.decode import decode_query
from firstfix.errors import FirstfixError, UnsupportedFormat
from firstfix.scan.scan import Scan
from firstfix.scan.sequence import ScanSequence
from firstfix.telemetry.redact import redact
from firstfix_cli.answerer import Answerer
from firstfix_ros.robot.answerer import of_robot

from .fleets_file import FleetEntry
from .http_scan import MAX_SCAN_BYTES, fetch_scan
from .planar_fix import NoFix, PlanarFix, planar_fix
from .scan_address import ScanAddress
from .scan_queue import ScanQueue, Seek, Wanted
from .topics import VehicleName

AT_ONCE = 4  # scans in memory, and queries of this gateway
BEHIND_AT_ONCE = 2  # of these, for URLs that gave no scan when they were asked last
MAX_TOPICS = 32  # on which scans are waited for
TOPIC_WAIT_S = 30.0  # for a scan on a topic
# After so long without a scan, a vehicle gives its topic's place to one that waits, and waits behind for the
# rest of its time: those that send none must not hold up all others.
FIRST_TURN_S = 2.0  # where the other one waits in front
TURN_S = 5.0  # where it waits behind


@dataclass(frozen=True)
class Fleet:
    """A fleet of the file, with who answers its queries."""

    name: str
    entry: FleetEntry
    ask: Answerer


@dataclass(frozen=True)
class Outcome:
    """Outcome of an attempt of a vehicle.

    Attributes:
        has_scan: the vehicle gave a scan.
    """

    vehicle: VehicleName
    attempt: int
    result: PlanarFix | NoFix
    has_scan: bool


@dataclass(frozen=True)
class _OnTopic:
    """A scan that is waited for on its topic, until ``until_s``."""

    wanted: Wanted
    fleet: Fleet
    since_s: float
    until_s: float


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
        self._fleets: dict[Seek, Fleet] = {}  # of those that wait
        self._for_urls, self._for_topics = ScanQueue(), ScanQueue()
        self._on_topic: dict[str, _OnTopic] = {}
        self._in_pool: dict[Seek, bool] = {}  # True: a URL that is asked from behind
        self._gave_none: set[VehicleName] = set()  # when they were asked last
        self._done: queue.SimpleQueue[Outcome] = queue.SimpleQueue()

    def seek(self, fleet: Fleet, vehicle: VehicleName, attempt: int) -> None:
        """Begin as soon as there is room. A vehicle that gave no scan the last time waits behind."""
        seek, address = (vehicle, attempt), ScanAddress(fleet.entry.scan)
        try:
            place = address.of(vehicle)
        except FirstfixError as error:
            self._end_without_scan(seek, str(error))
            return
        self._fleets[seek] = fleet
        waiting = self._for_topics if address.is_topic else self._for_urls
        waiting.add(Wanted(seek, place, TOPIC_WAIT_S, vehicle in self._gave_none))
        self._begin()

    def drop(self, vehicle: VehicleName, attempt: int) -> None:
        """End what has not begun yet. What runs in the pool ends by itself."""
        seek = vehicle, attempt
        self._fleets.pop(seek, None)
        self._for_urls.remove(seek)
        self._for_topics.remove(seek)
        for topic, one in list(self._on_topic.items()):
            if one.wanted.seek == seek:
                self._end_topic(topic)
                if self._clock() - one.since_s >= FIRST_TURN_S:
                    self._gave_none.add(vehicle)
        self._begin()

    def forget(self, vehicle: VehicleName) -> None:
        """Forget whether a vehicle gave a scan."""
        self._gave_none.discard(vehicle)

    def topics(self) -> list[str]:
        """The topics on which scans are waited for: a new connection subscribes to them again."""
        return list(self._on_topic)

    def take_scan(self, topic: str, body: bytes) -> bool:
        """Take a message that comes now. Returns whether it is a scan that was waited for."""
        one = self._on_topic.get(topic)
        if one is None:
            return False
        if len(self._in_pool) >= AT_ONCE:  # a later scan is as good
            now_s = self._clock()
            self._on_topic[topic] = replace(one, since_s=now_s, until_s=now_s + TOPIC_WAIT_S)
            return True
        self._end_topic(topic)
        if len(body) > MAX_SCAN_BYTES:
            self._end_without_scan(one.wanted.seek, f"its scan has more than {MAX_SCAN_BYTES} bytes")
        else:
            self._submit(one.wanted.seek, one.fleet, lambda: (body, one.fleet.entry.media_type), False)
        return True

    def outcomes(self) -> list[Outcome]:
        """Attempts that have ended since the last call."""
        now_s = self._clock()
        for topic, one in list(self._on_topic.items()):
            if now_s > one.until_s:
                self._end_topic(topic)
                reason = f"no scan came on its topic within {TOPIC_WAIT_S:g} s"
                self._end_without_scan(one.wanted.seek, reason)
        found = [self._done.get() for _ in range(self._done.qsize())]
        for outcome in found:
            self._in_pool.pop((outcome.vehicle, outcome.attempt), None)
            (self._gave_none.discard if outcome.has_scan else self._gave_none.add)(outcome.vehicle)
        self._begin()
        return found

    def close(self) -> None:
        """Ends after the running queries."""
        self._for_urls.clear()
        self._for_topics.clear()
        self._pool.shutdown(cancel_futures=True)

    def _begin(self) -> None:
        while self._has_place_for_url(wanted := self._for_urls.next()):
            self._for_urls.remove(wanted.seek)
            fleet = self._fleets.pop(wanted.seek)
            take = partial(fetch_scan, wanted.place, fleet.entry.media_type, self._tls)
            self._submit(wanted.seek, fleet, take, wanted.is_behind)
        while self._has_place_for_topic(wanted := self._for_topics.next()):
            self._for_topics.remove(wanted.seek)
            fleet, now_s = self._fleets.pop(wanted.seek), self._clock()
            if wanted.place in self._on_topic:
                self._end_without_scan(wanted.seek, "the topic of its scan is another vehicle's, too")
            else:
                self._on_topic[wanted.place] = _OnTopic(wanted, fleet, now_s, now_s + wanted.left_s)
                self._subscribe(wanted.place)

    def _has_place_for_url(self, wanted: Wanted | None) -> TypeGuard[Wanted]:
        if wanted is None:
            return False
        if wanted.is_behind and sum(self._in_pool.values()) >= BEHIND_AT_ONCE:
            return False
        return len(self._in_pool) < AT_ONCE - bool(
            self._on_topic
        )  # a scan that comes on a topic needs a place

    def _has_place_for_topic(self, wanted: Wanted | None) -> TypeGuard[Wanted]:
        if wanted is None:
            return False
        if len(self._on_topic) < MAX_TOPICS:
            return True
        return self._take_a_turn(wanted.is_behind)

    def _take_a_turn(self, is_behind: bool) -> bool:
        """Let the topic that has had its turn for longest wait behind. Returns whether there is one."""
        now_s, turn_s = self._clock(), TURN_S if is_behind else FIRST_TURN_S
        over = [
            (one.since_s, topic)
            for topic, one in self._on_topic.items()
            if now_s - one.since_s >= turn_s or (one.wanted.is_behind and not is_behind)
        ]
        if not over:
            return False
        one = self._end_topic(min(over)[1])
        self._gave_none.add(one.wanted.seek[0])
        self._fleets[one.wanted.seek] = one.fleet
        self._for_topics.add(replace(one.wanted, left_s=max(one.until_s - now_s, 0.0), is_behind=True))
        return True

    def _end_topic(self, topic: str) -> _OnTopic:
        self._unsubscribe(topic)
        return self._on_topic.pop(topic)

    def _end_without_scan(self, seek: Seek, reason: str) -> None:
        self._done.put(Outcome(*seek, NoFix(reason), False))

    def _submit(
        self, seek: Seek, fleet: Fleet, take: Callable[[], tuple[bytes, str]], is_behind: bool
    ) -> None:
        self._in_pool[seek] = is_behind

        def work() -> None:
            has_scan = False
            try:
                scan = _decoded(*take())
                has_scan = True
                result = _asked(fleet, seek[0], scan)
            except (FirstfixError, ConnectionError) as error:
                result = NoFix(redact(str(error))[:300])
            except Exception as error:  # a defect must not leave the vehicle without an outcome
                result = NoFix(f"defect: {error!r}"[:300])
            self._done.put(Outcome(*seek, result, has_scan))

        self._pool.submit(work)


def _decoded(body: bytes, media_type: str) -> Scan | ScanSequence:
    scan = decode_query(body, media_type)
    if not isinstance(scan, Scan | ScanSequence):
        raise UnsupportedFormat("its scan has no points: a compact query or a descriptor")
    return scan


def _asked(fleet: Fleet, vehicle: VehicleName, scan: Scan | ScanSequence) -> PlanarFix | NoFix:
    ask = of_robot(fleet.ask, f"{vehicle.manufacturer}/{vehicle.serial}")
    answer = ask(scan, LocalizeOptions(T_base_sensor=fleet.entry.mounting))
    return planar_fix(answer, fleet.entry.max_tilt_deg)
