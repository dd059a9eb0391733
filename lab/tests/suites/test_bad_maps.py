"""The set of good and bad maps: what is in it, and how it judges."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from firstfix_lab.suites.bad_maps import judge
from firstfix_lab.suites.bad_maps.cases import (
    GOOD,
    MapCase,
    cases,
    doubled,
    exchanged,
    scaled,
    thinned,
    turned,
    y_up,
)
from firstfix_lab.suites.bad_maps.judge import Judged
from firstfix_lab.suites.bad_maps.lying import (
    at_heights,
    leaning,
    rounded,
    sunk,
    without_ground,
    written_with,
)
from firstfix_lab.suites.bad_maps.places import NAMES, PlaceMap, is_available
from firstfix_lab.suites.bad_maps.program import is_right

LYING = ("doubled floors", "leaning", "base's poses", "no ground", "few digits", "single scan")


@pytest.fixture
def box(monkeypatch: pytest.MonkeyPatch) -> PlaceMap:
    """A hall of 20 x 12 x 4 m with a level floor, as the place of all cases."""
    rng = np.random.default_rng(5)
    size = np.array([20.0, 12.0, 4.0])
    points = rng.uniform(0, 1, (60_000, 3)) * size
    side = rng.integers(0, 5, len(points))
    for number, (axis, at) in enumerate(((2, 0.0), (0, 0.0), (0, 20.0), (1, 0.0), (1, 12.0))):
        points[side == number, axis] = at
    poses = np.tile(np.eye(4), (40, 1, 1))
    poses[:, :3, 3] = np.column_stack([np.linspace(2, 18, 40), np.full(40, 6.0), np.full(40, 1.0)])
    place = PlaceMap(points, poses, {})
    monkeypatch.setattr(judge, "place_map", lambda name: place)
    return place


def test_the_set_has_every_fault_and_every_good_place():
    faults = Counter(case.fault for case in cases())
    assert faults[GOOD] == 2 * len(NAMES) >= 20
    lying = {"doubled", "turned trajectory", *LYING}
    assert min(faults[one] for one in lying) >= 5
    assert set(faults) == {
        GOOD,
        *lying,
        "y up",
        "wrong unit",
        "too few points",
        "asked nothing",
    }
    names = [case.name for case in cases()]
    assert len(set(names)) == len(names)


def test_a_change_changes_what_its_name_says(box: PlaceMap):
    assert len(doubled(1.0, 0.4, of_half=True)(box).points) == pytest.approx(1.5 * len(box.points), rel=0.01)
    np.testing.assert_allclose(turned(90, "the origin")(box).poses[0, :3, 3], [-6, 2, 1], atol=1e-9)
    np.testing.assert_allclose(
        turned(180, "its middle")(box).poses[0, :3, 3], box.poses[-1, :3, 3], atol=1e-9
    )
    np.testing.assert_allclose(exchanged(box).poses[0, :3, 3], [6, 2, 1])
    np.testing.assert_allclose(scaled(1000)(box).poses[0, :3, 3], [2000, 6000, 1000])
    np.testing.assert_allclose(y_up(box).points[0], box.points[0, [1, 2, 0]])
    assert len(thinned(4000)(box).points) == 15


def test_a_map_that_lies_is_made_as_its_name_says(box: PlaceMap):
    deep = sunk(0.6)(box)
    assert len(deep.poses) == 2 * len(box.poses)
    assert deep.poses[-1, 2, 3] == pytest.approx(0.4), "the way back ends lowest"
    assert deep.points[:, 2].min() == pytest.approx(-0.6, abs=0.05)
    assert len(sunk(0.6, keeps_poses=False)(box).poses) == 0
    rise_m = np.ptp(leaning(5, 0)(box).poses[:, 2, 3])
    assert rise_m == pytest.approx(16 * np.sin(np.radians(5)), abs=0.01)
    np.testing.assert_allclose(at_heights(1.0, -0.05)(box).poses[:, 2, 3], -0.05)
    assert without_ground(1.0, 0.3)(box).points[:, 2].min() > 0.3
    assert len(np.unique(rounded(0.1)(box).points[:, 0])) <= 201
    text = written_with(6, 42_300)(box).points
    np.testing.assert_allclose(text[:, 0] * 10, np.round(text[:, 0] * 10), atol=1e-6)


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_nothing_is_found_in_good_maps_with_and_without_their_poses():
    good = [case for case in cases() if case.fault == GOOD and is_available(case.place)]
    found = {case.name: judge.by_check(case).codes for case in good}
    assert len(found) >= 16, "the project's own worlds"
    assert {name: codes for name, codes in found.items() if codes} == {}


@pytest.mark.parametrize(
    ("change", "outcome"),
    [(lambda right: right, "passed"), (y_up, "held back"), (scaled(1000), "refused")],
)
def test_the_check_of_a_map_says_what_becomes_of_it(box: PlaceMap, change, outcome: str):
    fault = GOOD if outcome == "passed" else "bad"
    judged = judge.by_check(MapCase(fault, "box", "", change))
    assert judged.outcome == outcome
    assert is_right(judged)


def test_a_good_map_may_be_warned_of_what_its_build_sees_alone():
    good, bad = MapCase(GOOD, "box", "", y_up), MapCase("bad", "box", "", y_up)
    assert is_right(Judged(good, "warned", ("map_in_part",), 1.0, 9, found=0.99))
    assert not is_right(Judged(good, "warned", ("map_doubled_walls",), 1.0, 9))
    assert not is_right(Judged(good, "held back", ("self_test_low",), 1.0, 9, found=0.2))
    assert not is_right(Judged(bad, "passed", (), 1.0, 9))
