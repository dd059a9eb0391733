"""GET /answers/counts: what was answered lately, by map."""

from __future__ import annotations

from pathlib import Path

import pytest
from access_world import get, give, localize
from service_world import SCAN_BODY, XYZ, Service, publish, running_service

from firstfix_service.localize import answer_counts
from firstfix_service.localize.answer_counts import DAY_S, HOUR_S, AnswerCounts, Counted
from waiting import wait_until

NOW_S = 1_800_000_000.0


def test_answers_are_counted_for_an_hour_and_a_day():
    counts = AnswerCounts()
    counts.add("hall", True, NOW_S - DAY_S - 600)
    counts.add("hall", False, NOW_S - 2 * HOUR_S)
    counts.add("hall", True, NOW_S - 60)
    counts.add("yard", False, NOW_S)
    hall, yard = counts.of_maps(NOW_S)
    assert (hall.map_id, hall.hour, hall.day) == ("hall", Counted(1, 1), Counted(2, 1))
    assert (yard.map_id, yard.hour, yard.last_time_s) == ("yard", Counted(1, 0), NOW_S)
    (hall, _) = counts.of_maps(NOW_S + HOUR_S + 600)
    assert (hall.hour, hall.day) == (Counted(), Counted(2, 1))


def test_the_counts_of_many_maps_take_bounded_memory(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(answer_counts, "MOST_MAPS", 3)
    counts = AnswerCounts()
    for number in range(5):
        counts.add(f"map-{number}", True, NOW_S + number)
    assert [one.map_id for one in counts.of_maps(NOW_S)] == ["map-2", "map-3", "map-4"]
    for step in range(1000):
        counts.add("map-4", True, NOW_S + step * answer_counts.STEP_S)
    assert len(counts._maps["map-4"].counts) <= DAY_S / answer_counts.STEP_S + 1


def test_a_replica_tells_what_it_answered(service: Service):
    def counted() -> dict[str, int]:
        maps = service.http.get("/answers/counts").json()["maps"]
        return {one["map_id"]: one["hour"]["answered"] for one in maps}

    before = counted()
    assert service.ask("http").ok
    assert service.ask("zenoh").ok
    replay = {"Content-Type": XYZ, "X-Request-Id": "replay-1"}  # a person tries a kept query
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
