"""Which places of a map are told as mapped in part, and what the report says of their scans."""

from types import SimpleNamespace

import numpy as np
import pytest

from firstfix_builder.self_test.mapped_places import IN_PART, MAX_TOLD, MappedPlaces
from firstfix_builder.simulation.simulate import upright
from tests.builder.self_test.two_rooms import DRIVE, HEIGHT_M, SENSOR, seen_from, simulator

LEFT, MIDDLE, RIGHT = (0, 0), (1, 0), (2, 0)


@pytest.fixture(scope="module")
def index() -> SimpleNamespace:
    """Templates half a metre apart in both rooms."""
    xs = np.concatenate([np.arange(0.5, 5.6, 0.5), np.arange(6.5, 11.6, 0.5)])
    x, y = (one.ravel() for one in np.meshgrid(xs, np.arange(0.5, 5.6, 0.5)))
    templates = SimpleNamespace(
        position_m=np.column_stack([x, y, np.full(len(x), HEIGHT_M)]).astype(np.float32)
    )
    return SimpleNamespace(seen_free=seen_from(DRIVE), cascade=SimpleNamespace(templates=templates))


def scans(cell: tuple[int, int], count: int, localized: int) -> dict[str, object]:
    return {"cell": list(cell), "scans": count, "localized": localized, "wrong": 0, "taken_for": None}


def test_the_cells_of_the_room_behind_the_door_are_mapped_in_part(index):
    mapped = MappedPlaces.of(index, upright(DRIVE), simulator(), SENSOR)
    assert set(mapped.never_seen) == {(x, y) for x in range(3) for y in range(2)}
    assert mapped.never_seen[LEFT] < 0.1
    assert mapped.never_seen[RIGHT] > 0.5
    assert {(2, 0), (2, 1)} <= set(mapped.in_part)
    assert not {(0, 0), (0, 1)} & set(mapped.in_part)
    assert mapped == MappedPlaces.of(index, upright(DRIVE), simulator(), SENSOR), "the same each time"


def test_nothing_is_said_without_poses_or_of_sparse_stations(index):
    assert MappedPlaces.of(index, None, simulator(), SENSOR) is None
    assert MappedPlaces.of(index, upright(DRIVE[::8]), simulator(), SENSOR) is None, "3 m apart"
    unknown = SimpleNamespace(seen_free=None, cascade=index.cascade)
    assert MappedPlaces.of(unknown, upright(DRIVE), simulator(), SENSOR) is None


def test_scans_are_counted_in_part_and_elsewhere():
    mapped = MappedPlaces({LEFT: 0.01, MIDDLE: IN_PART, RIGHT: 0.6, (3, 0): 0.9})
    grid = [scans(LEFT, 4, 3), scans(MIDDLE, 4, 3), scans(RIGHT, 5, 1), scans((9, 9), 7, 0)]
    assert mapped.to_mapping(grid) == {
        "places": 4,
        "in_part": 2,
        "localized_in_part": 0.2,
        "localized_elsewhere": 0.75,
        "without_scans": [{"cell": [3, 0], "never_seen": 0.9}],
    }
    left, middle, right, unknown = mapped.told_of(grid)
    assert left == {**grid[0], "never_seen": 0.01, "in_part": False}
    assert middle["in_part"] is False
    assert right == {**grid[2], "never_seen": 0.6, "in_part": True}
    assert unknown == grid[3]


def test_shares_of_no_scans_are_not_told_and_long_lists_are_cut():
    many = MappedPlaces({(x, 0): 0.5 for x in range(MAX_TOLD + 1)})
    told = many.to_mapping([])
    assert told["in_part"] == MAX_TOLD + 1
    assert len(told["without_scans"]) == MAX_TOLD
    assert told["localized_in_part"] is told["localized_elsewhere"] is None
