"""Whose scan is waited for: vehicles that send none do not hold up others. The clock is the test's."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
import pytest

from firstfix.answer.localization import Localization, Verdict
from firstfix.answer.options import LocalizeOptions
from firstfix.scan.scan import Scan
from firstfix.transform import make_transform, rotation_z
from firstfix.wire.scan import encode_scan
from firstfix_fleet.vda5050 import fix_seeker
from firstfix_fleet.vda5050.fix_seeker import (
    AT_ONCE,
    BEHIND_AT_ONCE,
    FIRST_TURN_S,
    MAX_TOPICS,
    TOPIC_WAIT_S,
    TURN_S,
    FixSeeker,
    Fleet,
    Outcome,
)
from firstfix_fleet.vda5050.fleets_file import FleetEntry
from firstfix_fleet.vda5050.planar_fix import NoFix, PlanarFix
from firstfix_fleet.vda5050.topics import VehicleName
from tests.waiting import LIMIT_S, wait_until

T_MAP_BASE = make_transform(rotation_z(0.5), [12.0, -4.0, 0.3])
SCAN = encode_scan(Scan(np.eye(3, dtype=np.float32).repeat(50, 0) * 5))
STEP_S = 0.25


def fleet(scan: str, ask: Callable[[object, LocalizeOptions], Localization] | None = None) -> Fleet:
    entry = FleetEntry(
        topics="uagv/+/acme/+", maps={"hall": None}, scan=scan, T_base_sensor=[0.0] * 6 + [1.0]
    )
    return Fleet("trucks", entry, ask or found)


def found(scan: object, options: LocalizeOptions) -> Localization:
    return Localization(
        Verdict.LOCALIZED, (), T_MAP_BASE, T_MAP_BASE, np.eye(6) * 1e-4, map_id="hall", map_version="ab" * 32
    )


def vehicle(name: object) -> VehicleName:
    return VehicleName("uagv", "v2", "acme", f"agv{name}")


class World:
    """A seeker, and the topics that it subscribes to."""

    def __init__(self) -> None:
        self.now_s = 0.0
        self.topics: list[str] = []
        self.outcomes: list[Outcome] = []
        self.attempts: dict[VehicleName, int] = {}
        self.seeker = FixSeeker(self.topics.append, self.topics.remove, lambda: self.now_s)

    def seek(
        self, name: object, scan: str = "mqtt:scans/{serial}", **how: Callable[..., Localization]
    ) -> None:
        one = vehicle(name)
        self.attempts[one] = self.attempts.get(one, 0) + 1
        self.seeker.seek(fleet(scan, **how), one, self.attempts[one])

    def waits_on(self, name: object) -> bool:
        return f"scans/agv{name}" in self.topics

    def seconds_until(self, is_so: Callable[[], bool]) -> float:
        """Lets time pass until it is so. What ends without a scan is sought again, as the vehicles do."""
        began_s = self.now_s
        while not is_so():
            assert self.now_s < began_s + 3600.0
            self.now_s += STEP_S
            for outcome in self.seeker.outcomes():
                self.outcomes.append(outcome)
                self.seek(outcome.vehicle.serial.removeprefix("agv"))
        return self.now_s - began_s


@pytest.fixture
def world() -> Iterator[World]:
    one = World()
    yield one
    one.seeker.close()


def test_scans_do_not_pile_up(world: World):
    gate, results = threading.Event(), []

    def ask(scan: object, options: LocalizeOptions) -> Localization:
        assert gate.wait(LIMIT_S)
        return found(scan, options)

    for number in range(10):
        world.seek(number, ask=ask)
    for number in range(10):
        assert world.seeker.take_scan(f"scans/agv{number}", SCAN)
    assert not world.seeker.take_scan("scans/agv39", SCAN)
    assert [world.waits_on(number) for number in range(6)] == [False] * AT_ONCE + [True] * 2
    gate.set()
    wait_until(lambda: results.extend(world.seeker.outcomes()) or len(results) == AT_ONCE)
    assert {one.vehicle for one in results} == {vehicle(number) for number in range(AT_ONCE)}
    assert all(isinstance(one.result, PlanarFix) and one.has_scan for one in results)


def test_a_scan_is_waited_for_so_long_and_no_longer(world: World):
    for number in range(MAX_TOPICS):
        world.seek(number)
    assert len(world.topics) == MAX_TOPICS
    took_s = world.seconds_until(lambda: bool(world.outcomes))
    assert took_s == TOPIC_WAIT_S + STEP_S
    assert len(world.outcomes) == MAX_TOPICS
    for one in world.outcomes:
        assert isinstance(one.result, NoFix)
        assert "no scan came on its topic within 30 s" in one.result.reason


@pytest.mark.parametrize("count", [150, 1500])
def test_a_first_attempt_waits_a_short_turn_of_those_before_it(world: World, count: int):
    for number in range(count):
        world.seek(number)
    world.seek("real")
    took_s = world.seconds_until(lambda: world.waits_on("real"))
    assert took_s <= (count // MAX_TOPICS + 1) * FIRST_TURN_S


def test_a_first_attempt_begins_at_once_where_others_have_failed(world: World):
    for number in range(1500):
        world.seek(number)
    world.seconds_until(lambda: world.now_s >= 1500 / MAX_TOPICS * FIRST_TURN_S + FIRST_TURN_S)
    assert len(world.topics) == MAX_TOPICS
    for number in range(MAX_TOPICS):
        world.seek(f"real{number}")
        assert world.waits_on(f"real{number}")
    assert len(world.topics) == MAX_TOPICS


def test_one_whose_last_attempt_brought_a_scan_does_not_wait_behind(world: World):
    world.seek("real", ask=lambda *_: Localization(Verdict.REJECTED, ()))
    assert world.seeker.take_scan("scans/agvreal", SCAN)
    wait_until(lambda: world.outcomes.extend(world.seeker.outcomes()) or world.outcomes)
    assert isinstance(world.outcomes[0].result, NoFix)
    for number in range(150):
        world.seek(number)
    world.seconds_until(lambda: world.now_s >= 150 / MAX_TOPICS * FIRST_TURN_S + FIRST_TURN_S)
    world.seek("real")
    assert world.waits_on("real")


@pytest.mark.parametrize("body", [b"no scan", b"x" * 100], ids=["malformed", "too large"])
def test_what_is_no_scan_counts_as_none(world: World, body: bytes, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(fix_seeker, "MAX_SCAN_BYTES", 50)
    world.seek("bad")
    assert world.seeker.take_scan("scans/agvbad", body)
    wait_until(lambda: world.outcomes.extend(world.seeker.outcomes()) or world.outcomes)
    assert not world.outcomes[0].has_scan
    for number in range(MAX_TOPICS):
        world.seek(number)
    world.seek("bad")
    assert not world.waits_on("bad")
    world.seek("real")
    took_s = world.seconds_until(lambda: world.waits_on("real"))
    assert took_s <= FIRST_TURN_S
    assert not world.waits_on("bad")


def test_one_that_failed_has_its_turn_again(world: World):
    """Its LiDAR was off: it sends scans now, among many others that do not."""
    for number in range(150):
        world.seek(number)
    world.seconds_until(lambda: world.now_s >= 300.0)
    if world.waits_on(77):
        world.seconds_until(lambda: not world.waits_on(77))
    took_s = world.seconds_until(lambda: world.waits_on(77))
    assert took_s <= (150 // MAX_TOPICS + 1) * (TURN_S + STEP_S)


def test_an_attempt_that_gave_up_its_turn_ends_after_its_whole_time(world: World):
    for number in range(64):
        world.seek(number)
    world.seconds_until(lambda: len(world.outcomes) >= 64)
    assert world.now_s <= 2 * TOPIC_WAIT_S + TURN_S


def test_one_that_is_dropped_and_lost_again_does_not_come_first(world: World):
    world.seek("odd")
    world.now_s += FIRST_TURN_S
    world.seeker.drop(vehicle("odd"), 1)
    assert not world.topics
    for number in range(MAX_TOPICS):
        world.seek(number)
    world.seek("odd")
    world.seek("real")
    world.seconds_until(lambda: world.waits_on("real"))
    assert not world.waits_on("odd")
    world.seeker.forget(vehicle("odd"))
    assert vehicle("odd") not in world.seeker._gave_none


def test_what_is_dropped_while_it_waits_never_begins(world: World):
    for number in range(MAX_TOPICS + 1):
        world.seek(number)
    world.seeker.drop(vehicle(MAX_TOPICS), 1)
    world.seeker.drop(vehicle(0), 1)
    assert len(world.topics) == MAX_TOPICS - 1
    assert not world.seeker._fleets


def test_urls_that_gave_no_scan_leave_places_to_others(world: World, monkeypatch: pytest.MonkeyPatch):
    """Hosts that do not answer hold their places for 10 s."""
    asked, gate, is_down = [], threading.Event(), [True]

    def fetch(url: str, media_type: str, tls: object) -> tuple[bytes, str]:
        asked.append(url.rpartition("/")[2])
        if is_down[0]:
            raise ConnectionError("it does not answer")
        assert gate.wait(LIMIT_S)
        return SCAN, media_type

    monkeypatch.setattr(fix_seeker, "fetch_scan", fetch)
    ended: list[Outcome] = []

    def seek_all(*names: object) -> None:
        for name in names:
            world.seek(name, "http://host/{serial}")

    def wait_for(count: int, what: Callable[[], int]) -> None:
        wait_until(lambda: ended.extend(world.seeker.outcomes()) or what() >= count)

    seek_all(*range(8))
    wait_for(8, partial(len, ended))
    is_down[0] = False
    asked.clear()
    seek_all(*range(8))
    wait_until(lambda: len(asked) == BEHIND_AT_ONCE)
    seek_all("real", "other", "last")
    wait_until(lambda: len(asked) == AT_ONCE)
    assert set(asked[BEHIND_AT_ONCE:]) == {"agvreal", "agvother"}
    ended.clear()
    gate.set()
    wait_for(11, partial(len, ended))
    assert all(one.has_scan for one in ended)


def test_a_scan_on_a_topic_finds_a_place_beside_urls(world: World, monkeypatch: pytest.MonkeyPatch):
    gate = threading.Event()

    def fetch(url: str, media_type: str, tls: object) -> tuple[bytes, str]:
        assert gate.wait(LIMIT_S)
        raise ConnectionError("it does not answer")

    monkeypatch.setattr(fix_seeker, "fetch_scan", fetch)
    world.seek("real")
    for number in range(20):
        world.seek(number, "http://host/{serial}")
    assert world.seeker.take_scan("scans/agvreal", SCAN)
    wait_until(lambda: world.outcomes.extend(world.seeker.outcomes()) or world.outcomes)
    assert world.outcomes[0].vehicle == vehicle("real")
    assert world.outcomes[0].has_scan
    gate.set()


def test_two_vehicles_with_one_topic(world: World):
    for name in ("a", "b"):
        entry = "mqtt:scans/{serial}"
        one = VehicleName("uagv", "v2", name, "agv1")
        world.seeker.seek(fleet(entry), one, 1)
    (outcome,) = world.seeker.outcomes()
    assert (outcome.vehicle.manufacturer, outcome.has_scan) == ("b", False)
    assert isinstance(outcome.result, NoFix)
    assert "another vehicle's" in outcome.result.reason
