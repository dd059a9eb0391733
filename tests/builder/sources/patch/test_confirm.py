"""Changes that a fleet confirms, and poisonings that must not pass."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from firstfix.engine.changes.cells import CELL_M
from firstfix.scan.scan import Scan
from firstfix.transform import make_transform, rotation_z
from firstfix_builder.simulation.boxes import Boxes
from firstfix_builder.sources.patch.observation import Observation, seen_by
from tests.builder.sources.patch.fleet import (
    CHANGED,
    DAY_S,
    MAPPED,
    MOVED,
    RACK,
    WITH_BOTH,
    Fleet,
    changes_in,
    days,
    is_refused,
)

pytestmark = pytest.mark.slow
TWO = ("ann", "bob")


@pytest.fixture(scope="module")
def honest() -> list[Observation]:
    """Two robots on four days in the changed hall, a day after they have seen it as it was mapped."""
    fleet = Fleet()
    return [*fleet.drive(MAPPED, TWO, days(0)), *fleet.drive(CHANGED, TWO, days(1, 2, 3, 4))]


def outside_m(boxes: Boxes, cells: np.ndarray) -> float:
    """How far the cells' middles lie outside the boxes, at most."""
    middle = (cells + 0.5) * CELL_M
    beyond = np.abs(middle[:, None] - boxes.centre_m) - boxes.half_m
    return float(np.linalg.norm(np.maximum(beyond, 0), axis=2).min(axis=1).max())


def test_what_two_robots_see_for_days_is_confirmed(honest: list[Observation]) -> None:
    found = changes_in(honest)
    assert {change.kind for change in found} == {"gone", "new"}
    for change in found:
        place = RACK if change.kind == "gone" else Boxes.joined(RACK, MOVED)  # the floor below it is new
        assert outside_m(place, change.cells) < 0.8
        assert change.robots == set(TWO)
        assert change.days >= 3
        assert change.since_s >= days(1)[0]
    largest = {kind: max(len(c.cells) for c in found if c.kind == kind) for kind in ("gone", "new")}
    assert min(largest.values()) >= 10


def test_an_unchanged_hall_has_no_change() -> None:
    assert changes_in(Fleet().drive(MAPPED, TWO, days(0, 1, 2, 3))) == []


def test_poison_one_robot() -> None:
    """It may see the change as often as it likes."""
    assert is_refused(Fleet().drive(CHANGED, ["ann"], days(*range(6)), scans=5), robots=1)


def test_poison_one_robot_and_a_stray_query_of_another(honest: list[Observation]) -> None:
    others = [one for one in honest if one.robot == "bob" and one.time_s >= days(1)[0]]
    mine = [one for one in honest if one.robot == "ann"]
    assert is_refused([*mine, *others[:2]], robots=1)


def test_poison_one_hour() -> None:
    """Also around midnight, which parts two days."""
    for at_s in (days(1, hour=9)[0], days(1, hour=23.7)[0]):
        minutes = [at_s + 600 * number for number in range(4)]
        seen = Fleet().drive(CHANGED, ["ann", "bob", "cat"], minutes, scans=3)
        assert is_refused(seen, days=1, robot_days=1, span_s=0)


def test_poison_one_day() -> None:
    hours = [days(1, hour=hour)[0] for hour in (7, 11, 15, 19)]
    assert is_refused(Fleet().drive(CHANGED, TWO, hours), days=1, robot_days=1, span_s=0)


def test_poison_glass() -> None:
    """A pane that some scans meet and others see through, on all days alike."""
    fleet = Fleet()
    for share in (0.4, 0.7):
        seen = fleet.drive(WITH_BOTH, TWO, days(0, 1, 2, 3), seen_as=fleet.glass(share))
        assert changes_in(seen) == []


def test_poison_parked_lorry() -> None:
    """It stands there for two days and nights, and leaves."""
    fleet = Fleet()
    stays = fleet.drive(WITH_BOTH, TWO, days(1, 2))
    assert is_refused([*fleet.drive(MAPPED, TWO, days(0)), *stays], days=2, span_s=0)
    left = fleet.drive(MAPPED, TWO, days(3, 4, 5))
    longer = fleet.drive(WITH_BOTH, TWO, days(2.5), scans=2)
    assert changes_in([*stays, *longer, *left]) == []


def test_poison_lorry_that_comes_every_morning() -> None:
    fleet = Fleet()
    there = fleet.drive(WITH_BOTH, TWO, days(0, 1, 2, 3, hour=8))
    gone = fleet.drive(MAPPED, TWO, days(0, 1, 2, 3, hour=15))
    assert changes_in([*there, *gone]) == []


def test_poison_furniture_that_is_moved_back() -> None:
    fleet = Fleet()
    moved, back = fleet.drive(CHANGED, TWO, days(0, 1, 2)), fleet.drive(MAPPED, TWO, days(3, 4, 5))
    assert changes_in(moved), "for three days it was so"
    assert changes_in([*moved, *back]) == []


def test_poison_replayed_scan() -> None:
    """The scans of one morning, sent again on later days and under other names, also in another format."""
    once = Fleet().drive(CHANGED, ["ann"], days(1), scans=6)
    again = []
    for number, robot in enumerate(("ann", "bob", "cat", "bob", "cat"), start=1):
        for one in once:
            rounded = Scan.from_points(np.round(one.scan.points[:-40], 3))
            again.append(replace(one, robot=robot, time_s=one.time_s + number * DAY_S, scan=rounded))
    seen, left_out = seen_by(MAPPED.index, [*once, *again])
    assert left_out.replayed == len(again)
    assert len(seen) <= len(once)
    assert changes_in([*once, *again]) == []
    honest = Fleet().drive(CHANGED, ["ann", "bob", "cat"], days(1, 2, 3), scans=2)
    assert changes_in(honest), "as many scans, each of its own"


@pytest.mark.parametrize("by_m", [(0.0, 1.5, 0.0), (0.7, 0.0, 0.0), (0.0, -0.4, 0.0)])
def test_poison_wrong_pose(by_m: tuple[float, float, float]) -> None:
    """Two robots that are localized beside their places in an unchanged hall, always by the same error."""
    off = make_transform(np.eye(3), by_m)
    seen = Fleet().drive(MAPPED, TWO, days(0, 1, 2, 3))
    doubtful = [replace(one, T_map_sensor=off @ one.T_map_sensor) for one in seen]
    assert seen_by(MAPPED.index, doubtful)[1].doubtful >= 0.9 * len(doubtful)
    assert changes_in(doubtful) == []


def test_poison_a_pose_at_the_other_end() -> None:
    """Some scans of every day are localized at the opposite place, which looks much the same."""
    middle = make_transform(np.eye(3), [8.0, 5.5, 0.0])
    turned = middle @ make_transform(rotation_z(np.pi), [0, 0, 0]) @ np.linalg.inv(middle)
    seen = Fleet().drive(MAPPED, TWO, days(0, 1, 2, 3), scans=6)
    some = [
        replace(one, T_map_sensor=turned @ one.T_map_sensor) if number % 3 == 0 else one
        for number, one in enumerate(seen)
    ]
    assert changes_in(some) == []


def test_poison_a_robot_that_lies_among_honest_ones() -> None:
    """A robot for whom the rack has gone, beside one that sees it, and one that was there in an hour only."""
    fleet = Fleet()
    lies = fleet.drive(CHANGED, ["ann", "eve"], days(1, 2, 3))
    truth = fleet.drive(MAPPED, ["bob"], days(1, 2, 3))
    assert changes_in([*lies, *truth]) == []


def test_poison_something_on_the_robot() -> None:
    """A load on two robots: for each scan there is something, but at no place of the hall always."""
    rng = np.random.default_rng(1)

    def loaded(points: np.ndarray, T: np.ndarray) -> np.ndarray:
        load = rng.uniform([0.8, -0.4, -0.5], [1.2, 0.4, 0.3], (400, 3))
        return np.concatenate([points, load]).astype(np.float32)

    assert changes_in(Fleet().drive(MAPPED, TWO, days(0, 1, 2, 3), seen_as=loaded)) == []


def test_the_order_of_the_queries_does_not_matter(honest: list[Observation]) -> None:
    mixed = [honest[row] for row in np.random.default_rng(2).permutation(len(honest))]
    one, other = changes_in(honest), changes_in(mixed)
    assert [change.cells.tolist() for change in one] == [change.cells.tolist() for change in other]


def test_a_change_at_night_counts_from_then_on(honest: list[Observation]) -> None:
    """Sightings of the mapped state from before the change do not speak against it."""
    before = Fleet(seed=8).drive(MAPPED, TWO, days(-3, -2, -1))
    assert {change.kind for change in changes_in([*before, *honest])} == {"gone", "new"}
