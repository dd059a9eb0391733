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
from firstfix_lab.suites.bad_maps.places import NAMES, PlaceMap
from firstfix_lab.suites.bad_maps.program import is_right


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
    assert faults[GOOD] == len(NAMES) >= 11
    assert min(faults["doubled"], faults["turned trajectory"]) >= 5
    assert set(faults) == {
        GOOD,
        "doubled",
        "turned trajectory",
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
