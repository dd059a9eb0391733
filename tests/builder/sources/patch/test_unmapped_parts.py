"""Parts that were never mapped: a patch takes them up by the rule of every change, and says what they are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from firstfix.engine.index import MapIndex
from firstfix_builder.simulation.boxes import Boxes
from firstfix_builder.sources.patch.confirm import Change, PatchRule, confirmed_changes
from firstfix_builder.sources.patch.map_patch import MapPatch, patch_of
from firstfix_builder.sources.patch.observation import Observation, Seen, seen_by
from firstfix_builder.sources.patch_reader import areas_of
from tests.builder.sources.patch.fleet import FIXED, RACK, SIZE_M, Fleet, days
from tests.changed_hall import Hall, driven, standing

pytestmark = pytest.mark.slow
TWO = ("ann", "bob")
# The mapping run has driven all through the hall but did not see one shelf, which has stood there all along.
SHELF_M = (10.2, 6.3, 0.0, 12.0, 7.4, 1.8)
HIDDEN_M = (9.7, 5.8, 0.2, 12.5, 7.9, 2.3)
SHELF = standing(SHELF_M)
CAME = standing((5.5, 2.6, 0.0, 6.7, 3.8, 1.6))
DRIVE_M = np.array([[x, y, 1.0] for y in (2.0, 9.2) for x in np.arange(1.5, 14.6, 1.0)])
THEN = Hall(SIZE_M, Boxes.joined(FIXED, RACK, SHELF))
NOW = Hall(SIZE_M, Boxes.joined(FIXED, SHELF, CAME))
ALL = Hall(SIZE_M, Boxes.joined(THEN.things, CAME))


@pytest.fixture(scope="module")
def index() -> MapIndex:
    return driven(THEN, DRIVE_M, hidden=HIDDEN_M)


@pytest.fixture(scope="module")
def honest() -> list[Observation]:
    """Two robots all over the hall: a day before a rack has moved, and four days after it."""
    fleet = Fleet(halls=(THEN, NOW), all_of_them=ALL)
    return [*fleet.drive(THEN, TWO, days(0), scans=6), *fleet.drive(NOW, TWO, days(1, 2, 3, 4), scans=6)]


def confirmed(
    index: MapIndex, observations: list[Observation], **rule: float
) -> tuple[list[Seen], list[Change]]:
    seen, _ = seen_by(index, observations)
    return seen, confirmed_changes(seen, PatchRule(**rule))  # type: ignore[arg-type]


def share_in(boxes: Boxes, points: np.ndarray) -> float:
    """Share of (n, 3) points that lie in one of the boxes, or within 0.3 m of it."""
    beyond = np.abs(points[:, None] - boxes.centre_m) - boxes.half_m
    return float((np.linalg.norm(np.maximum(beyond, 0), axis=2).min(axis=1) <= 0.3).mean())


def test_a_part_that_was_never_mapped_is_told_from_what_has_come(
    index: MapIndex, honest: list[Observation]
) -> None:
    _, changes = confirmed(index, honest)
    cells = {kind: [np.empty((0, 3))] for kind in ("gone", "new", "unmapped")}
    for change in changes:
        for area in change.areas:
            cells[area.kind].append((area.cells + 0.5) * 0.5)
    gone, new, unmapped = (np.concatenate(cells[kind]) for kind in ("gone", "new", "unmapped"))
    assert min(len(gone), len(new), len(unmapped)) >= 5
    assert share_in(RACK, gone) == 1
    assert share_in(CAME, new) > 0.8
    assert share_in(CAME, unmapped) == 0
    assert share_in(SHELF, unmapped) > 0.5
    told = areas_of(changes)
    assert {area["kind"] for area in told} == {"gone", "new", "unmapped"}
    assert {area["robots"] for area in told} == {2}


def test_what_a_patch_does_not_depend_on_what_the_mapping_run_saw(
    index: MapIndex, honest: list[Observation]
) -> None:
    """Telling apart names areas. It neither confirms a cell nor adds a point."""
    cloud = THEN.points_and_normals[0].astype(np.float64)
    made: list[tuple[list[Change], MapPatch]] = []
    for each in (index, replace(index, seen_free=None)):
        seen, changes = confirmed(each, honest)
        made.append((changes, patch_of(changes, seen, each, cloud, robots=2, voxel_m=0.1)))
    (known, patch), (unknown, same) = made
    assert any(change.unmapped.any() for change in known)
    assert not any(change.unmapped.any() for change in unknown)
    assert len(known) == len(unknown)
    for one, other in zip(known, unknown, strict=True):
        assert np.array_equal(one.cells, other.cells)
        assert (one.kind, one.since_s, one.robots, one.days) == (
            other.kind, other.since_s, other.robots, other.days
        )  # fmt: skip
    assert np.array_equal(patch.added, same.added)
    assert np.array_equal(patch.removed, same.removed)
    assert len(patch.added) > 100


@pytest.mark.parametrize(
    ("robots", "times_s", "loosened"),
    [
        (["ann"], days(*range(6)), {"robots": 1}),
        (TWO, [days(1, hour=hour)[0] for hour in (7, 11, 15, 19)], {"days": 1, "robot_days": 1, "span_s": 0}),
        (TWO, days(1, 2), {"days": 2, "span_s": 0}),
    ],
    ids=["one robot", "one day", "two days"],
)
def test_a_part_that_was_never_mapped_needs_as_many_robots_and_days(
    index: MapIndex, robots: list[str], times_s: list[float], loosened: dict[str, float]
) -> None:
    """Though nobody has ever seen it otherwise."""
    fleet = Fleet(halls=(THEN, NOW), all_of_them=ALL)
    seen = fleet.drive(THEN, robots, times_s, scans=8)
    _, found = confirmed(index, seen, **loosened)
    assert any(change.unmapped.any() for change in found), "with lower bars it would be laid into the map"
    assert confirmed(index, seen)[1] == []


def test_what_comes_and_goes_where_nobody_has_mapped_is_not_confirmed(index: MapIndex) -> None:
    """The shelf is a trolley that stands there every morning."""
    empty = Hall(SIZE_M, Boxes.joined(FIXED, RACK))
    fleet = Fleet(halls=(empty, THEN), all_of_them=THEN)
    there = fleet.drive(THEN, TWO, days(0, 1, 2, 3, hour=8), scans=6)
    gone = fleet.drive(empty, TWO, days(0, 1, 2, 3, hour=15), scans=6)
    assert any(change.unmapped.any() for change in confirmed(index, there)[1])
    assert confirmed(index, [*there, *gone])[1] == []
