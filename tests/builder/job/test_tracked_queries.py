"""Queries that a robot's own motion confirms: two fixes with the odometry between them."""

from __future__ import annotations

from datetime import datetime, timedelta, timezone
from typing import Any

import numpy as np
import pytest

from firstfix.answer.localization import Localization, Verdict
from firstfix.answer.options import LocalizeOptions
from firstfix.answer.prior import Prior
from firstfix.catalog.recorded_queries import RecordedQuery, new_query_id
from firstfix.transform import Matrix, inverse, make_transform, pose_error, pose_from_mapping, rotation_z
from firstfix_builder.job.tracked_queries import TRACKING, tracked_queries

BEGIN = datetime(2026, 11, 2, 9, 0, tzinfo=timezone.utc)
T_BASE_SENSOR = make_transform(rotation_z(0.3), [0.2, 0.0, 1.1])
T_MAP_ODOM = make_transform(rotation_z(-2.0), [40.0, 7.0, 0.0])  # where the odometry happened to begin
SPEED_M_S = 0.5


def T_map_base(time_s: float) -> Matrix:
    """A robot that drives on a circle of 20 m."""
    angle = time_s * SPEED_M_S / 20.0
    return make_transform(rotation_z(angle), [20.0 * np.cos(angle), 20.0 * np.sin(angle), 0.0])


def query(time_s: float, wrong: Matrix | None = None, **changes: Any) -> RecordedQuery:
    """A recorded query of a robot at a time.

    Args:
        wrong: its answer lies off by so much.
        changes: ``verdict``, ``drift`` (4, 4) of its odometry, ``prior``, ``still_s`` (it stands where it was
            then), ``robot``, ``map_id``; ``odometry`` is False: it sends none.
    """
    T_map = T_map_base(changes.get("still_s", time_s))
    T_answer = (np.eye(4) if wrong is None else wrong) @ T_map @ T_BASE_SENSOR
    verdict = changes.get("verdict", Verdict.LOCALIZED)
    map_id = changes.get("map_id", "hall")
    answer = (
        Localization(verdict, T_map_sensor=T_answer, map_id=map_id)
        if verdict is Verdict.LOCALIZED
        else Localization(verdict, map_id=map_id)
    )
    T_odom = changes.get("drift", np.eye(4)) @ inverse(T_MAP_ODOM) @ T_map
    options = LocalizeOptions(
        T_base_sensor=T_BASE_SENSOR,
        T_odom_base=T_odom if changes.get("odometry", True) else None,
        prior=Prior(T_answer[:3, 3].copy(), 10.0) if changes.get("prior") else None,
    )
    time = BEGIN + timedelta(seconds=time_s)
    return RecordedQuery(
        new_query_id(f"{round(time_s):08x}", time), time.isoformat(), "zenoh", "r", "", map_id, "", "",
        options.to_strings(), answer.to_mapping(), 100, robot=changes.get("robot", "ann"),
    )  # fmt: skip


def shift(x: float, yaw: float = 0.0) -> Matrix:
    return make_transform(rotation_z(yaw), [x, 0.0, 0.0])


def errors_of(recorded_queries: list[RecordedQuery]) -> dict[float, float]:
    """Error in metres of each confirmed place, by the time of its query."""
    found = {}
    for recorded in tracked_queries(recorded_queries, "hall"):
        time_s = (datetime.fromisoformat(recorded.time) - BEGIN).total_seconds()
        T = pose_from_mapping(recorded.truth["T_map_sensor"])
        found[time_s] = pose_error(T_map_base(time_s) @ T_BASE_SENSOR, T)[0]
    return found


def test_two_fixes_with_the_same_motion_between_confirm_each_other():
    found = tracked_queries([query(90.0), query(0.0)], "hall")
    assert {one.truth["told_by"] for one in found} == {TRACKING}
    assert [one.truth["told_at"][11:19] for one in found] == ["09:00:00", "09:01:30"]
    assert [one.truth["map_id"] for one in found] == ["hall", "hall"]
    assert errors_of([query(0.0), query(90.0)]) == pytest.approx({0.0: 0.0, 90.0: 0.0}, abs=1e-6)


@pytest.mark.parametrize("verdict", [Verdict.REJECTED, Verdict.AMBIGUOUS])
def test_a_scan_between_them_that_was_not_localized_gets_its_place(verdict: Verdict):
    found = errors_of([query(0.0), query(30.0, verdict=verdict), query(90.0)])
    assert found == pytest.approx({0.0: 0.0, 30.0: 0.0, 90.0: 0.0}, abs=1e-6)


def test_a_wrong_fix_between_them_gets_its_true_place():
    wrong = query(40.0, shift(12.0), prior=True)
    assert errors_of([query(0.0), wrong, query(90.0)])[40.0] == pytest.approx(0.0, abs=1e-6)


def test_a_wrong_fix_without_a_prior_gets_its_true_place_too():
    found = errors_of([query(0.0), query(70.0, shift(12.0)), query(140.0)])
    assert found == pytest.approx({0.0: 0.0, 70.0: 0.0, 140.0: 0.0}, abs=1e-6)


def test_an_odometry_that_drifts_a_little_confirms_and_its_places_are_the_nearer_fixs():
    drift = shift(0.3)
    found = errors_of([query(0.0), query(20.0, verdict=Verdict.REJECTED), query(90.0, drift=drift)])
    assert found == pytest.approx({0.0: 0.0, 20.0: 0.0, 90.0: 0.0}, abs=1e-6)


@pytest.mark.parametrize(
    "second",
    [
        query(30.0),  # too soon
        query(700.0),  # too late: odometry drifts
        query(90.0, still_s=0.0),  # it stands
        query(90.0, shift(3.0)),  # at another place
        query(90.0, shift(0.0, np.radians(20.0))),
        query(90.0, drift=shift(5.0)),  # the odometry began anew
        query(90.0, prior=True),  # where it was told to search
        query(90.0, odometry=False),
        query(90.0, verdict=Verdict.AMBIGUOUS),
        query(90.0, robot="bob"),
        query(90.0, map_id="attic"),
    ],
)
def test_a_second_fix_that_confirms_nothing(second: RecordedQuery):
    assert tracked_queries([query(0.0), second], "hall") == []


def test_a_robot_that_cannot_be_told_apart_confirms_nothing():
    assert tracked_queries([query(0.0, robot=""), query(90.0, robot="")], "hall") == []


def test_where_two_places_repeat_themselves_nothing_is_confirmed():
    """The right fixes and the wrong ones are both consistent, as in two equal aisles."""
    recorded_queries = [query(time_s) for time_s in (0.0, 80.0, 160.0)]
    recorded_queries += [query(time_s, shift(12.0)) for time_s in (5.0, 85.0, 165.0)]
    assert errors_of(recorded_queries) == {}
    assert len(errors_of(recorded_queries[:3] + recorded_queries[3:4])) == 4, (
        "one wrong fix alone contradicts nothing"
    )


def test_damaged_records_are_left_out():
    good = [query(0.0), query(90.0)]
    bad = [
        RecordedQuery(**{**vars(query(45.0)), "options": {"T_odom_base": "1,2"}}),
        RecordedQuery(**{**vars(query(46.0)), "time": "today"}),
        RecordedQuery(**{**vars(query(47.0)), "answer": {"verdict": "localized", "map_id": "hall"}}),
    ]
    assert set(errors_of(good + bad)) == {0.0, 90.0}
