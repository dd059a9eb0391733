"""The share of space that a mapping run never saw, in two rooms of which it drove through one."""

import numpy as np
import pytest

from firstfix.engine.verification.seen_free import SeenFree
from firstfix_builder.self_test.never_seen import never_seen
from firstfix_builder.simulation.simulate import Simulator
from tests.builder.self_test.two_rooms import DRIVE, HEIGHT_M, MESH, SENSOR, seen_from, simulator

LEFT = np.array([[1.5, 1.5, HEIGHT_M], [3.0, 3.0, HEIGHT_M], [4.5, 4.5, HEIGHT_M]])
RIGHT = LEFT + [6.0, 0.0, 0.0]
ACROSS = np.column_stack([np.linspace(7, 11, 9), np.full(9, 3.0), np.full(9, HEIGHT_M)])


@pytest.fixture(scope="module")
def rooms() -> Simulator:
    return simulator()


def test_a_room_seen_through_its_door_was_mostly_never_seen(rooms):
    seen = seen_from(DRIVE)
    left, right = never_seen(seen, rooms, SENSOR, LEFT), never_seen(seen, rooms, SENSOR, RIGHT)
    assert left.max() < 0.1
    assert right.min() > 0.5


def test_driving_through_the_other_room_changes_it(rooms):
    seen = seen_from(np.concatenate([DRIVE, ACROSS]))
    assert never_seen(seen, rooms, SENSOR, np.concatenate([LEFT, RIGHT])).max() < 0.1


def test_where_nothing_or_all_was_seen_the_share_is_whole_or_none(rooms):
    bricks = np.stack(np.meshgrid(*[np.arange(-2, 20)] * 3), axis=-1).reshape(-1, 3).astype(np.int32)
    everywhere = SeenFree.of_bricks(bricks, np.full((len(bricks), 8, 2), -1, np.int32), 0.1)
    nowhere = SeenFree.of_bricks(bricks, np.zeros((len(bricks), 8, 2), np.int32), 0.1)
    assert never_seen(everywhere, rooms, SENSOR, LEFT).tolist() == [0, 0, 0]
    assert never_seen(nowhere, rooms, SENSOR, LEFT).tolist() == [1, 1, 1]


def test_one_place_has_the_same_share_alone_and_among_others(rooms):
    seen = seen_from(DRIVE)
    together = never_seen(seen, rooms, SENSOR, np.concatenate([LEFT, RIGHT]))
    alone = [never_seen(seen, rooms, SENSOR, place[None])[0] for place in (*LEFT, *RIGHT)]
    assert together.tolist() == alone


def test_rays_without_an_end_say_nothing():
    far = Simulator(MESH.vertices + [500.0, 0, 0], MESH.triangles)
    assert np.isnan(never_seen(seen_from(DRIVE), far, SENSOR, LEFT)).all()
    assert len(never_seen(seen_from(DRIVE), far, SENSOR, LEFT[:0])) == 0
