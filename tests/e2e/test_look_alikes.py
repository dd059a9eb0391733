"""Rooms that look alike: known aliases compete, and a hint leads to where they differ."""

import shutil
import time
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from firstfix.answer.hint import Hint
from firstfix.answer.localization import Localization, Verdict
from firstfix.answer.options import LocalizeOptions
from firstfix.answer.prior import Prior
from firstfix.descriptor import Described
from firstfix.engine.array_file import map_arrays, save_arrays
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer, localize_among
from firstfix.engine.retrieval.alias_table import FILE
from firstfix.engine.retrieval.cascade import Matches
from firstfix.errors import CorruptVersion
from firstfix.scan.sequence import ScanSequence
from firstfix.transform import pose_error
from tests.python_cascade import PythonCascade, searched_by
from tests.storey_world import ROOMS_X, pose, scan_at, storey, storey_version

HERE, WRONG = pose(ROOMS_X[0], 0.3, 40), pose(ROOMS_X[1], 0.3, 40)


class WrongRoom(PythonCascade):
    """A cascade that finds templates of one wrong room alone."""

    def compare(self, described: Described, rows: NDArray[np.integer]) -> Matches:
        found = super().compare(described, rows)
        near = np.abs(self.templates.position_m[found.rows, 0] - WRONG[0, 3]) < 3.2
        return Matches(found.rows[near], found.yaw_rad[near], found.score[near])


@pytest.fixture(scope="module")
def version(once_a_run):
    return storey_version(once_a_run).directory


@pytest.fixture(scope="module")
def storey_index(version):
    return MapIndex.load(version)


@pytest.fixture(scope="module")
def confused_index(storey_index):
    """The index with a search that proposes places of one wrong room alone."""
    return searched_by(storey_index, WrongRoom)


@pytest.fixture(scope="module")
def scan():
    return scan_at(storey(), HERE, 4)


def is_at(T_map_sensor, place):
    return pose_error(T_map_sensor, place)[0] < 0.1


class TestWrongRoom:
    def test_is_localized_by_a_version_without_the_table(self, confused_index, scan):
        answer = Localizer(replace(confused_index, aliases=None)).localize(scan)
        assert answer.verdict is Verdict.LOCALIZED
        assert is_at(answer.T_map_sensor, WRONG)
        assert "aliases" not in answer.timings_ms

    def test_ties_with_the_right_one_by_the_table(self, confused_index, scan):
        answer = Localizer(confused_index).localize(scan)
        assert answer.verdict is Verdict.AMBIGUOUS
        for place in (HERE, WRONG):
            assert any(is_at(one.T_map_sensor, place) for one in answer.hypotheses)

    def test_gives_way_to_a_better_fitting_room(self, confused_index):
        """From the door one sees the corridor, whose end tells the rooms apart: only ties are left to it."""
        there = pose(ROOMS_X[0] + 2.0, 2.45, -90)
        seen = scan_at(storey(), there, 4)
        before, after = (
            Localizer(one).localize(seen) for one in (replace(confused_index, aliases=None), confused_index)
        )
        assert before.verdict is Verdict.LOCALIZED
        assert not is_at(before.T_map_sensor, there)
        assert is_at(after.hypotheses[0].T_map_sensor, there)

    def test_is_localized_where_a_prior_excludes_the_aliases(self, confused_index, scan):
        prior = Prior(WRONG[:3, 3], 3.0)
        answer = Localizer(confused_index).localize(scan, LocalizeOptions(prior=prior))
        assert answer.verdict is Verdict.LOCALIZED
        assert all(prior.allows(one.T_map_sensor) for one in answer.hypotheses)

    def test_is_tried_by_the_callers_own_threshold(self, confused_index, scan):
        """A place that only the caller accepts has aliases too."""
        calibration = replace(confused_index.calibration, min_probability=1.0)
        asked = Localizer(replace(confused_index, calibration=calibration))
        answer = asked.localize(scan, LocalizeOptions(min_probability=0.9))
        assert answer.verdict is Verdict.AMBIGUOUS
        assert asked.localize(scan).timings_ms.get("aliases") is None, "nothing would be localized"

    def test_stays_if_the_deadline_leaves_no_time(self, confused_index, scan):
        answer = Localizer(confused_index).localize(scan, deadline=time.monotonic())
        assert answer.verdict is Verdict.LOCALIZED
        assert "aliases" not in answer.timings_ms

    def test_has_only_the_aliases_of_its_map(self, confused_index, scan):
        known, unknown = Localizer(confused_index), Localizer(replace(confused_index, aliases=None))
        alone = known.localize(scan)
        answer = localize_among({"known": known, "unknown": unknown}, scan)
        of_map = {one.map_id: 0 for one in answer.hypotheses}
        for one in answer.hypotheses:
            of_map[one.map_id] += is_at(one.T_map_sensor, HERE)
        assert alone.verdict is Verdict.AMBIGUOUS
        assert of_map == {"known": 1, "unknown": 0}


def test_a_clear_place_stays_localized(storey_index):
    there = pose(11.0, 3.7, 20)
    seen = scan_at(storey(), there, 3)
    before, after = (
        Localizer(one).localize(seen) for one in (replace(storey_index, aliases=None), storey_index)
    )
    assert before.verdict is after.verdict is Verdict.LOCALIZED
    assert is_at(after.T_map_sensor, there)
    assert np.array_equal(before.T_map_sensor, after.T_map_sensor)
    assert "aliases" in after.timings_ms


@pytest.mark.parametrize(
    ("alias_margin", "y", "verdict"),
    [(0.06, 2.6, Verdict.LOCALIZED), (0.2, 2.6, Verdict.AMBIGUOUS), (0.2, 2.9, Verdict.LOCALIZED)],
)
def test_an_alias_ties_within_the_width_that_the_map_learned(storey_index, alias_margin, y, verdict):
    """At the door the scan fits the room that looks alike worse by 0.07. One step on it is a clear lead."""
    there = pose(24.3, y, 180)
    calibration = replace(storey_index.calibration, alias_margin=alias_margin)
    answer = Localizer(replace(storey_index, calibration=calibration)).localize(scan_at(storey(), there, 4))
    assert answer.verdict is verdict
    assert is_at(answer.hypotheses[0].T_map_sensor, there)


def test_every_room_has_the_others_as_aliases(storey_index):
    templates = storey_index.cascade.templates
    rooms = np.array(ROOMS_X)
    at_m = templates.position_m @ storey_index.T_map_level[:3, :3].T + storey_index.T_map_level[:3, 3]
    in_room = (np.abs(at_m[:, None, 0] - rooms) < 2).any(axis=1) & (np.abs(at_m[:, 1]) < 1.5)
    assert in_room.sum() > 30
    others = []
    for template in np.flatnonzero(in_room):
        _, alias, _, _ = storey_index.aliases.of(np.array([template]))
        there = np.linalg.norm(
            at_m[alias][:, None, :2]
            - (at_m[template, :2] - [rooms[np.abs(at_m[template, 0] - rooms).argmin()], 0])
            - np.column_stack([rooms, 0 * rooms]),
            axis=2,
        )
        own = np.abs(at_m[template, 0] - rooms).argmin()
        others.append(np.delete(there.min(axis=0), own).max() < 1.0)
    assert np.mean(others) > 0.9


def test_a_version_without_the_file_answers(version, tmp_path, scan):
    for path in version.iterdir():
        if path.name != FILE:
            (tmp_path / path.name).symlink_to(path)
    storey_index = MapIndex.load(tmp_path)
    assert storey_index.aliases is None
    assert Localizer(storey_index).localize(scan).hypotheses


def test_a_damaged_file_refuses_the_version(version, tmp_path):
    folder = shutil.copytree(version, tmp_path / "damaged")
    arrays = dict(map_arrays(version / FILE))
    arrays["row"] = np.where(arrays["row"] == 3, 10**6, arrays["row"]).astype(np.int32)
    save_arrays(folder / FILE, arrays)
    with pytest.raises(CorruptVersion, match=FILE):
        MapIndex.load(folder)
    (folder / FILE).write_bytes(b"nothing")
    with pytest.raises(CorruptVersion):
        MapIndex.load(folder)


@pytest.fixture(scope="module")
def storey_localizer(storey_index):
    return Localizer(storey_index)


@pytest.mark.parametrize("room_x", ROOMS_X)
def test_the_hint_leads_out_of_the_door_and_a_second_scan_localizes(storey_localizer, room_x):
    world, start = storey(), pose(room_x, 0.0, 0)
    scan = scan_at(world, start, 4)
    alone = storey_localizer.localize(scan)
    assert alone.verdict is Verdict.AMBIGUOUS
    assert alone.hint is not None
    assert alone.hint.distance_m == pytest.approx(np.linalg.norm(alone.hint.T_sensor_goal[:3, 3]))
    goal = start @ alone.hint.T_sensor_goal
    assert goal[1, 3] > 2.5, "the corridor is north of the rooms, and alike inside"
    together = storey_localizer.localize(ScanSequence.along([scan, scan_at(world, goal, 54)], [start, goal]))
    assert together.verdict is Verdict.LOCALIZED
    assert pose_error(goal, together.T_map_sensor)[0] < 0.1


def test_the_hint_turns_with_the_sensor(storey_localizer):
    """The goal is in the sensor's own frame: a sensor that is turned gets a goal that is turned."""
    world = storey()
    for yaw_deg in (0, 90, -140):
        start = pose(ROOMS_X[0], 0.0, yaw_deg)
        hint = storey_localizer.localize(scan_at(world, start, 4)).hint
        assert hint is not None
        assert (start @ hint.T_sensor_goal)[1, 3] > 2.5


def test_a_clear_place_has_no_hint(storey_localizer):
    seen = scan_at(storey(), pose(11.0, 3.7, 20), 3)
    clear = storey_localizer.localize(seen)
    assert clear.verdict is Verdict.LOCALIZED
    assert clear.hint is None
    assert "hint" not in clear.timings_ms


def test_a_hint_is_encoded():
    hint = Hint(pose(2.0, -1.0, 30), 2.0, 30.0, 0.25, (0, 2))
    sent = Localization(Verdict.AMBIGUOUS, hint=hint)
    received = Localization.from_mapping(sent.to_mapping()).hint
    assert received is not None
    np.testing.assert_allclose(received.T_sensor_goal, hint.T_sensor_goal, atol=1e-12)
    assert received.to_mapping() == hint.to_mapping()
    assert Localization.from_mapping({"verdict": "ambiguous"}).hint is None
