"""Rooms that look alike, with different doors: the hint of an ambiguous answer leads to where they differ."""

import numpy as np
import pytest

from firstfix.answer.hint import Hint
from firstfix.answer.localization import Localization, Verdict
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer
from firstfix.scan.sequence import ScanSequence
from firstfix.transform import pose_error
from tests.storey_world import ROOMS_X, pose, scan_at, storey, storey_version


@pytest.fixture(scope="module")
def localizer(once_a_run):
    return Localizer(MapIndex.load(storey_version(once_a_run).directory))


@pytest.mark.parametrize("room_x", ROOMS_X)
def test_it_leads_out_of_the_door_and_the_second_scan_tells(localizer, room_x):
    world, start = storey(), pose(room_x, 0.0, 0)
    scan = scan_at(world, start, 4)
    alone = localizer.localize(scan)
    assert alone.verdict is Verdict.AMBIGUOUS
    assert alone.hint is not None
    assert alone.hint.distance_m == pytest.approx(np.linalg.norm(alone.hint.T_sensor_goal[:3, 3]))
    goal = start @ alone.hint.T_sensor_goal
    assert goal[1, 3] > 2.5, "the corridor is north of the rooms, and alike inside"
    together = localizer.localize(ScanSequence.along([scan, scan_at(world, goal, 54)], [start, goal]))
    assert together.verdict is Verdict.LOCALIZED
    assert pose_error(goal, together.T_map_sensor)[0] < 0.1


def test_it_is_the_same_move_in_every_mounting_of_the_sensor(localizer):
    """The goal is in the sensor's own frame: a sensor that is turned gets a goal that is turned."""
    world = storey()
    for yaw_deg in (0, 90, -140):
        start = pose(ROOMS_X[0], 0.0, yaw_deg)
        hint = localizer.localize(scan_at(world, start, 4)).hint
        assert hint is not None
        assert (start @ hint.T_sensor_goal)[1, 3] > 2.5


def test_there_is_none_when_the_place_is_clear_or_nothing_differs_within_reach(localizer):
    seen = scan_at(storey(), pose(11.0, 3.7, 20), 3)
    clear = localizer.localize(seen)
    assert clear.verdict is Verdict.LOCALIZED
    assert clear.hint is None
    assert "hint" not in clear.timings_ms


def test_the_encoding_carries_it():
    hint = Hint(pose(2.0, -1.0, 30), 2.0, 30.0, 0.25, (0, 2))
    sent = Localization(Verdict.AMBIGUOUS, hint=hint)
    received = Localization.from_mapping(sent.to_mapping()).hint
    assert received is not None
    np.testing.assert_allclose(received.T_sensor_goal, hint.T_sensor_goal, atol=1e-12)
    assert received.to_mapping() == hint.to_mapping()
    assert Localization.from_mapping({"verdict": "ambiguous"}).hint is None
