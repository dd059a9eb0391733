"""Confirmed queries: which are drawn, and what is left out of the self-test."""

from __future__ import annotations

from collections import Counter
from datetime import datetime, timedelta, timezone
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from firstfix.catalog.recorded_queries import RecordedQueries
from firstfix.errors import StoreUnavailable
from firstfix.store.store import Store
from firstfix_builder.job.confirmed_queries import ConfirmedQueries, collect_confirmed
from firstfix_builder.self_test.confirmed_scans import decode_confirmed
from firstfix_builder.sources.read_map.held_out import HeldOut
from tests.builder.fixtures import record_query

TODAY = datetime.now(timezone.utc).replace(minute=0, second=0, microsecond=0)
BODY = np.ones((60, 3), "<f4").tobytes()


class Recorded:
    """Recorded queries in a store, each with a truth."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.recorded_queries = RecordedQueries(Store.open("memory://"))

    def record(
        self,
        robot: str,
        ago_s: float,
        x: float = 0.0,
        body: bytes = BODY,
        map_id: str = "hall",
        **options: str,
    ) -> str:
        time = TODAY - timedelta(seconds=ago_s)
        answer = {"verdict": "ambiguous", "reasons": [], "probability": 0.4}
        query_id = record_query(self.recorded_queries, time, answer, body, robot=robot, options=options)
        pose = {"position": [x, 0.0, 1.0], "quaternion": [0.0, 0.0, 0.0, 1.0]}
        self.recorded_queries.set_truth(query_id, {"map_id": map_id, "T_map_sensor": pose}, "key:eve")
        return query_id

    def collect(self, most: int = 40) -> ConfirmedQueries:
        folder = collect_confirmed(self.recorded_queries, "hall", most, self.folder / "confirmed")
        assert folder is not None
        return ConfirmedQueries.load(folder)


@pytest.fixture
def recorded(tmp_path: Path) -> Recorded:
    return Recorded(tmp_path)


def test_a_confirmed_query_is_collected_with_who_has_told(recorded: Recorded):
    query_id = recorded.record("ann", 100.0, 4.0, gravity="0,0,-1", prior="1,2,3,5", min_probability="0.5")
    (query,) = recorded.collect().queries
    assert query.file == f"queries/{query_id}"
    assert (query.robot, query.told_by, query.told_at[:2]) == ("ann", "key:eve", "20")
    assert query.T_map_sensor["position"] == [4.0, 0.0, 1.0]
    assert query.options == {"gravity": "0,0,-1"}, "a prior would help it"
    assert (recorded.folder / "confirmed" / query.file).read_bytes() == BODY


def test_without_confirmed_queries_there_is_no_folder(recorded: Recorded):
    elsewhere = recorded.record("ann", 0.0, map_id="attic")
    undone = recorded.record("ann", 1.0)
    recorded.recorded_queries.set_truth(undone, {})
    outside = recorded.record("ann", 2.0)
    recorded.recorded_queries.set_truth(outside, {"map_id": "hall", "T_map_sensor": None})
    assert recorded.recorded_queries.get(elsewhere).truth
    assert collect_confirmed(recorded.recorded_queries, "hall", 40, recorded.folder / "confirmed") is None
    recorded.record("ann", 3.0)
    assert collect_confirmed(recorded.recorded_queries, "hall", 0, recorded.folder / "confirmed") is None


def test_no_robot_and_no_hour_dominates(recorded: Recorded):
    for number in range(60):
        recorded.record("ann", 3600.0 * (number % 12), x=10.0 * number)
        recorded.record("bob" if number % 2 else "cat", 30.0, x=10.0 * number)
    found = recorded.collect(40)
    robots, hours = (
        Counter(one.robot for one in found.queries),
        Counter(one.time_s // 3600 for one in found.queries),
    )
    assert robots["ann"] == 20, "half, though there are more of it"
    assert robots["bob"] + robots["cat"] <= 10
    assert max(hours.values()) == 10, "a quarter"
    (reason,) = found.left_out.values()
    assert "not drawn: at most 40 are asked, 20 of one robot, 10 of one hour" in reason
    assert found == recorded.collect(40), "by seeded chance"


def test_every_place_gives_one_before_any_gives_two(recorded: Recorded):
    for number in range(30):
        recorded.record("ann", 3600.0 * number, x=0.1 * number)
    for number in range(4):
        recorded.record("bob", 3600.0 * number, x=50.0 + 10.0 * number)
    found = recorded.collect(6)
    x = [one.T_map_sensor["position"][0] for one in found.queries]
    assert {50.0, 60.0, 70.0} & set(x), "rare places come first"
    assert sum(one.robot == "bob" for one in found.queries) == 3
    places = [one // 5 for one in x]
    assert places == sorted(places), "neighbours in space are neighbours"


def test_a_robot_that_stands_still_is_asked_once_an_hour(recorded: Recorded):
    for number in range(9):
        recorded.record("ann", -60.0 * number)
    assert len(recorded.collect().queries) == 1


def test_old_ones_do_not_count(recorded: Recorded):
    recorded.record("ann", 91 * 86400.0)
    recorded.record("ann", 89 * 86400.0)
    found = recorded.collect()
    assert len(found.queries) == 1
    assert found.left_out == {"1 confirmed queries": "older than 90 days"}


def test_a_store_that_fails_stops_no_build(recorded: Recorded, monkeypatch: pytest.MonkeyPatch):
    def fail() -> Any:
        raise StoreUnavailable("no answer")

    monkeypatch.setattr(recorded.recorded_queries, "ids_told_first", fail)
    found = recorded.collect()
    assert found.queries == ()
    assert found.left_out == {"confirmed queries": "they cannot be read: no answer"}


def test_bodies_are_decoded_and_bad_ones_left_out(recorded: Recorded):
    recorded.record("ann", 0.0, x=20.0, twist="0,0,0,0,0,0", gravity="0,0,-1")
    bad = recorded.record("bob", 0.0, body=b"12345")
    recorded.collect()
    decode_confirmed(recorded.folder / "confirmed", recorded.folder / "decoded")
    found = HeldOut.load(recorded.folder / "decoded")
    (one,) = found.scans
    assert found.reasons.keys() == {bad}
    assert len(one.scan.points) == 60
    assert one.confirmation is not None
    assert one.confirmation.options.keys() == {"gravity"}, "a motion is nothing without times"
    assert one.T_sensor[:3, 3].tolist() == [20.0, 0.0, 1.0]


def test_a_robots_tracking_confirms_where_nobody_has_told(recorded: Recorded):
    def record(ago_s: float, x: float, verdict: str) -> str:
        pose = {"position": [x, 0.0, 1.0], "quaternion": [0.0, 0.0, 0.0, 1.0]}
        answer = {
            "verdict": verdict,
            "reasons": [],
            "probability": 0.9,
            "map_id": "hall",
            "T_map_sensor": pose,
        }
        time, options = TODAY - timedelta(seconds=ago_s), {"T_odom_base": f"{x - 30.0},0,1,0,0,0,1"}
        return record_query(recorded.recorded_queries, time, answer, BODY, options=options)

    first, last = record(200.0, 0.0, "localized"), record(100.0, 16.0, "localized")
    between = record(150.0, 8.0, "ambiguous")
    found = {Path(one.file).name: one for one in recorded.collect().queries}
    assert set(found) == {first, between, last}
    assert {one.told_by for one in found.values()} == {"tracking"}
    assert found[between].T_map_sensor["position"] == pytest.approx([8.0, 0.0, 1.0])
    told = {"position": [3.0, 0.0, 1.0], "quaternion": [0.0, 0.0, 0.0, 1.0]}
    recorded.recorded_queries.set_truth(between, {"map_id": "hall", "T_map_sensor": told}, "key:eve")
    found = {Path(one.file).name: one for one in recorded.collect().queries}
    assert found[between].told_by == "key:eve", "what a person tells stands"
    assert found[between].T_map_sensor == told
    assert not recorded.recorded_queries.get(first).truth, "no record is changed"
