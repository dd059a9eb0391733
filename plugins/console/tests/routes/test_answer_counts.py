"""GET /answers/counts: what was answered lately, by map."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from firstfix_service.localize import answer_counts
from firstfix_service.localize.answer_counts import DAY_S, HOUR_S, AnswerCounts, Counted
from tests.service.access_world import get, give, localize
from tests.service.service_world import SCAN_BODY, XYZ, Service, publish, running_service
from tests.waiting import wait_until

NOW_S = 1_000_000.0


class Counting:
    """Counts of answers, with a clock that the test sets."""

    def __init__(self) -> None:
        self.now_s = NOW_S
        self.counts = AnswerCounts(lambda: self.now_s)

    def add(self, map_id: str, is_localized: bool, now_s: float) -> None:
        self.now_s = now_s
        self.counts.add(map_id, is_localized, self.now_s)


def test_answers_are_counted_for_an_hour_and_a_day():
    counting = Counting()
    counting.add("hall", True, NOW_S - DAY_S - 600)
    counting.add("hall", False, NOW_S - 2 * HOUR_S)
    counting.add("hall", True, NOW_S - 60)
    counting.add("yard", False, NOW_S)
    hall, yard = counting.counts.of_maps()
    assert (hall.map_id, hall.hour, hall.day) == ("hall", Counted(1, 1), Counted(2, 1))
    assert (hall.last_age_s, yard.last_age_s) == (60.0, 0.0)
    assert (yard.map_id, yard.hour) == ("yard", Counted(1, 0))
    counting.now_s = NOW_S + HOUR_S + 600
    (hall, _) = counting.counts.of_maps()
    assert (hall.hour, hall.day) == (Counted(), Counted(2, 1))


def test_the_counts_of_many_maps_take_bounded_memory(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(answer_counts, "MAX_MAPS", 3)
    counting = Counting()
    for number in range(5):
        counting.add(f"map-{number}", True, NOW_S + number)
    assert [one.map_id for one in counting.counts.of_maps()] == ["map-2", "map-3", "map-4"]
    for step in range(1000):
        counting.add("map-4", True, NOW_S + step * answer_counts.STEP_S)
    assert len(counting.counts._maps["map-4"].counts) <= DAY_S / answer_counts.STEP_S + 1


def test_a_wall_clock_that_is_set_back_moves_no_answers(monkeypatch: pytest.MonkeyPatch):
    """Answers that were counted while the clock was a day ahead would be of the last hour for a day."""
    counting = Counting()
    monkeypatch.setattr(time, "time", lambda: NOW_S + DAY_S)
    counting.add("hall", True, NOW_S)
    monkeypatch.setattr(time, "time", lambda: NOW_S)
    counting.now_s += 2 * HOUR_S
    (hall,) = counting.counts.of_maps()
    assert (hall.hour, hall.day, hall.last_age_s) == (Counted(), Counted(1, 1), 2 * HOUR_S)


def test_a_replica_tells_what_it_answered(service: Service):
    def counted() -> dict[str, int]:
        maps = service.http.get("/answers/counts").json()["maps"]
        return {one["map_id"]: one["hour"]["answered"] for one in maps}

    before = counted()
    assert service.ask("http").ok
    assert service.ask("zenoh").ok
    replay = {"Content-Type": XYZ, "X-Request-Id": "replay-1"}  # a person tries a recorded query
    assert service.http.post("/localize?map=hall", content=SCAN_BODY, headers=replay).is_success
    assert counted()["hall"] == before.get("hall", 0) + 2


def test_a_caller_sees_the_counts_of_its_own_maps(tmp_path: Path):
    with running_service(tmp_path, zenoh=False, auth="on", keys_refresh_s=0.1) as service:
        for name in ("hall", "attic"):
            publish(service.catalog, name, "1", service.scratch)
        everywhere, of_hall = give(service, "build"), give(service, "build", maps=("hall",))
        robot = give(service, "localize")
        for name in ("hall", "attic"):
            wait_until(lambda name=name: localize(service, everywhere, f"?map={name}").is_success)
        wait_until(lambda: get(service, "/caller", robot).is_success)
        said = get(service, "/answers/counts", of_hall).json()
        assert [one["map_id"] for one in said["maps"]] == ["hall"]
        assert get(service, "/answers/counts", robot).status_code == 403
