"""Cells that count as changed: votes of spots, and a warehouse whose aisle moves."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from numpy.typing import NDArray

from firstfix.engine.changes.areas import CellVotes, find_areas, newest_first
from firstfix.engine.changes.cells import Spot, cells_of, keys_of
from firstfix.engine.changes.collector import AGAIN_S, Collector
from firstfix.engine.changes.sighting import Sighting, sighting_of
from firstfix.engine.changes.tally import Tally
from firstfix_builder.simulation.rays import Rays
from tests.changed_hall import SENSOR, free_poses, surface_points, warehouse, with_error

NOTHING = np.empty(0, np.int64)
PLACE = np.sort(keys_of(np.array([[x, 4, 2] for x in range(4)])))


def told(spot: Spot, **cells: NDArray[np.int64]) -> Sighting:
    names = ("confirmed", "contradicted", "unexplained", "free")
    return Sighting(spot, *(cells.get(name, NOTHING) for name in names))


def tally(count: int, first: int = 0, **cells: NDArray[np.int64]) -> Tally:
    """One sighting from each of so many spots."""
    return Tally.sum([Tally.of(told((first + 7 * n, 0, 1), **cells)) for n in range(count)])


def kinds(found: Tally) -> list[str]:
    return [area.kind for area in find_areas(found)]


@pytest.mark.parametrize(
    ("tallies", "found"),
    [
        ([tally(2, contradicted=PLACE)], []),  # some spots must agree
        ([tally(8, contradicted=PLACE)], ["gone"]),
        ([tally(8, unexplained=PLACE)], ["new"]),
        ([tally(8, confirmed=PLACE)], []),
        ([tally(20, contradicted=PLACE[:1])], []),  # one cell is no area
        ([tally(20, unexplained=PLACE), *[tally(20, free=PLACE)] * 9], []),  # somebody stood there once
        ([*[tally(20, unexplained=PLACE)] * 9, tally(20, free=PLACE)], ["new"]),
    ],
)
def test_areas_are_cells_that_enough_spots_agree_about(tallies: list[Tally], found: list[str]):
    assert kinds(Tally.sum(tallies)) == found


def test_a_robot_that_stands_still_has_one_vote():
    parked = Tally.sum([Tally.of(told((1, 1, 1), contradicted=PLACE))] * 1000)
    assert parked.sightings == 1000
    assert kinds(parked) == []
    votes = CellVotes.of(Tally.sum([parked, tally(6, 30, confirmed=PLACE)]), "gone")
    assert votes.share.max() <= 1 / 4
    assert kinds(Tally.sum([parked, tally(6, 30, confirmed=PLACE)])) == []
    assert kinds(Tally.sum([parked, tally(8, 30, contradicted=PLACE)])) == ["gone"]


def test_cells_beside_a_changed_one_need_less_confidence():
    beside = keys_of(np.array([[4, 4, 2]]))  # touches the last cell of PLACE
    apart = keys_of(np.array([[6, 4, 2], [7, 4, 2], [8, 4, 2]]))
    sure, two = tally(8, contradicted=PLACE), tally(2, contradicted=np.sort(np.r_[beside, apart]))
    (area,) = find_areas(Tally.sum([sure, two]))
    assert keys_of(area.cells).tolist() == [*PLACE.tolist(), *beside.tolist()]
    denied = tally(8, 100, confirmed=beside)
    (area,) = find_areas(Tally.sum([sure, two, denied]))
    assert keys_of(area.cells).tolist() == PLACE.tolist()
    assert find_areas(two) == []


def test_areas_are_connected_cells_with_a_box():
    apart = np.concatenate([PLACE, keys_of(np.array([[40, 4, 2], [41, 5, 2], [42, 4, 3]]))])
    areas = find_areas(tally(8, contradicted=np.sort(apart)))
    assert [len(area.cells) for area in areas] == [4, 3]
    low, high = areas[1].box_m
    assert low.tolist() == [20.0, 2.0, 1.0]
    assert high.tolist() == [21.5, 3.0, 2.0]
    assert areas[0].sightings[:, 0].tolist() == [8] * 4
    assert areas[0].share.tolist() == [1.0] * 4


def test_the_newest_sightings_of_a_cell_decide():
    today, before = tally(40, contradicted=PLACE), tally(60, confirmed=PLACE)
    assert kinds(newest_first([today, *[before] * 20])) == ["gone"]
    assert kinds(newest_first([before, *[today] * 20])) == []
    few = tally(2, contradicted=PLACE)
    assert kinds(newest_first([few, before])) == [], "few sightings of today are not enough alone"


def test_a_sum_does_not_depend_on_the_order():
    parts = [tally(3, 5 * k, contradicted=PLACE[k:], confirmed=PLACE[:k]) for k in range(4)]
    one, other = Tally.sum(parts), Tally.sum([Tally.sum(parts[2:]), Tally.sum(parts[:2])])
    for name in ("cell", "slot", "counts"):
        assert np.array_equal(getattr(one, name), getattr(other, name))
    assert one.sightings == other.sightings == 12
    one.check()


def test_a_collector_knows_the_spots_of_the_last_minutes():
    collector = Collector()
    collector.add(told((1, 2, 3), contradicted=PLACE), 1000.0)
    assert collector.take().sightings == 1
    assert collector.knows((1, 2, 3), 1000.0 + AGAIN_S - 1)
    assert not collector.knows((1, 2, 3), 1000.0 + AGAIN_S)
    assert not collector.knows((1, 2, 4), 1000.0)
    assert len(collector.take()) == 0


def test_a_collector_counts_free_cells_where_something_was_not_explained():
    collector = Collector()
    collector.add(told((1, 2, 3), free=PLACE))
    collector.add(told((2, 2, 3), unexplained=PLACE[:2]))
    collector.add(told((3, 2, 3), free=PLACE))
    counts = collector.take()
    assert np.unique(counts.cell).tolist() == PLACE[:2].tolist()
    assert counts.counts.sum(axis=0).tolist() == [0, 0, 2, 2, 0]


def test_the_aisle_that_moved_is_found():
    """Simulated queries at random places of the changed warehouse, with noise, people and errors of the pose.

    Recall: of the cells in which at least five queries see, with three rays, what left or came. Precision:
    cells that the moved racks do not touch are wrong.
    """
    old, new, before, after = warehouse(7)
    rng = np.random.default_rng(7)
    mapped, changed = old.simulator(), new.simulator()
    poses = free_poses(changed, new.size_m, 90, rng)
    collector, rays = Collector(), Rays.of_sensor(SENSOR)
    seen: dict[str, Counter[int]] = {"gone": Counter(), "new": Counter()}
    for T in poses:
        scan = new.scan(changed, T, rng, people=2.0)
        collector.add(sighting_of(old.index, scan, with_error(T, rng)))
        then, now = (next(each.ranges(T[None], SENSOR, rays))[0] for each in (mapped, changed))
        for kind, near, far in (("gone", then, now), ("new", now, then)):
            rows = np.flatnonzero((near < 20) & np.isfinite(far) & (far > near + 0.5))
            ends = T[:3, 3] + rays.turned(T).directions[rows] * near[rows, None]
            cell, count = np.unique(keys_of(cells_of(ends)), return_counts=True)
            seen[kind].update(cell[count >= 3].tolist())
    areas = find_areas(collector.take())
    for kind, racks in (("gone", before), ("new", after)):
        vertices, triangles = racks.mesh()
        touched = set(keys_of(cells_of(surface_points(vertices[triangles], 0.1)[0])).tolist())
        found = {key for area in areas if area.kind == kind for key in keys_of(area.cells).tolist()}
        true = {cell for cell, count in seen[kind].items() if count >= 5}
        assert len(true) > 100
        assert len(found & true) / len(true) >= 0.85
        assert len(found & (touched | set(seen[kind]))) / len(found) >= 0.9
