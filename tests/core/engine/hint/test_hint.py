"""Hints: outlooks from two places and their misfit, free ways, and goals in the open sectors."""

import numpy as np
import pytest

from firstfix.engine.hint.outlook import FieldOfView, Outlook
from firstfix.engine.hint.ways import DIRECTIONS, Floor, free_lengths, goals_at
from firstfix.engine.index import MapView
from firstfix.scan.reduction import RangeView, directions
from firstfix.transform import make_transform, rotation_z

UP = np.array([0.0, 0, 1])


def box(centre_x, length_m):
    """Points of a room around (centre_x, 0), 6 m wide, that ends ``length_m`` ahead of its centre."""
    side, z = np.linspace(-3, 3, 60), np.linspace(0, 2.5, 26)
    along = np.arange(-3, length_m, 0.1)
    walls = [
        *((centre_x + along, np.full(len(along), y)) for y in (-3.0, 3.0)),
        (np.full(60, centre_x - 3), side),
        (np.full(60, centre_x + length_m), side),
    ]
    return np.concatenate([[(x, y, h) for x, y in zip(*wall, strict=True) for h in z] for wall in walls])


def at(x):
    return make_transform(np.eye(3), [x, 0, 1.0])


def sees(azimuth_deg=360.0):
    along = directions().astype(np.float32)
    inside = np.abs(np.degrees(np.arctan2(along[:, 1], along[:, 0]))) <= azimuth_deg / 2
    return FieldOfView.of(RangeView.of(5 * along[inside & (np.abs(along[:, 2]) < 0.26)]))


@pytest.fixture(scope="module")
def view():
    """Three rooms: two alike, and one that is longer."""
    return MapView.of(np.concatenate([box(0, 4.0), box(40, 4.0), box(80, 8.0)]), reach_m=25.0)


def test_outlooks_of_equal_places_fit_and_others_do_not(view):
    first, twin, longer = (Outlook.at(view, at(x)) for x in (0.0, 40.0, 80.0))
    assert first.misfit(twin, sees()) < 0.005
    assert first.misfit(longer, sees()) > 0.05
    assert longer.misfit(first, sees()) > first.misfit(longer, sees()), "its scan sees through the near wall"


def test_a_sensor_that_looks_back_sees_no_difference(view):
    turned = make_transform(rotation_z(np.pi), np.zeros(3))
    first, longer = (Outlook.at(view, at(x) @ turned) for x in (0.0, 80.0))
    assert first.misfit(longer, sees(90)) < 0.005
    ahead = [Outlook.at(view, at(x)) for x in (0.0, 80.0)]
    assert ahead[0].misfit(ahead[1], sees(90)) > 0.2


def test_turning_helps_only_a_sensor_that_does_not_see_all_round():
    assert sees().is_all_round(UP)
    assert not sees(90).is_all_round(UP)


def test_an_outlook_of_nothing_has_no_misfit(view):
    nowhere = Outlook.at(view, at(1000.0))
    assert nowhere.misfit(Outlook.at(view, at(0.0)), sees()) == 0.0


HEIGHT_M = 1.0


def wall(start, end, low_m=0.0, high_m=2.0):
    """Points of an upright wall between two (x, y), in a frame HEIGHT_M above the floor."""
    along = np.linspace(0, 1, 200)[:, None]
    ground = np.asarray(start) + along * (np.asarray(end, float) - start)
    return np.concatenate(
        [np.column_stack([ground, np.full(200, z - HEIGHT_M)]) for z in np.linspace(low_m, high_m, 20)]
    )


def room(door=True):
    """A room of 6 x 6 m with a door 1.2 m wide in the middle of its wall at x = 3, and a wall at x = 8."""
    front = [wall((3, -3), (3, -0.6)), wall((3, 0.6), (3, 3))] if door else [wall((3, -3), (3, 3))]
    sides = [wall((-3, -3), (3, -3)), wall((-3, 3), (3, 3)), wall((-3, -3), (-3, 3))]
    return np.concatenate([*front, *sides, wall((8, -3), (8, 3))])


def test_the_way_ends_before_a_wall_and_leads_through_a_door():
    lengths = free_lengths(room(), HEIGHT_M)
    assert 7 < lengths[0] < 8
    assert all(2 < length < 3 for length in lengths[[DIRECTIONS // 4, DIRECTIONS // 2, 3 * DIRECTIONS // 4]])
    assert free_lengths(room(door=False), HEIGHT_M)[0] < 3


def test_floor_ceiling_and_flat_things_are_no_obstacles():
    flat = np.random.default_rng(0).uniform(-8, 8, (4000, 2))
    for z in (0.0, 0.15, 2.5):
        points = np.column_stack([flat, np.full(len(flat), z - HEIGHT_M)])
        assert np.isinf(free_lengths(points, HEIGHT_M)).all()
    assert np.isinf(free_lengths(np.zeros((0, 3)), HEIGHT_M)).all()


def test_a_goal_stands_in_every_open_sector():
    near, far = (goals_at(free_lengths(room(), HEIGHT_M), way_m) for way_m in (2.0, 4.0))
    np.testing.assert_allclose(np.linalg.norm(near, axis=1), 2.0)
    assert len(near) > 8
    assert np.linalg.norm(near[:, None] - near, axis=2)[np.triu_indices(len(near), 1)].min() > 0.5
    np.testing.assert_allclose(far, [[4.0, 0.0]], atol=0.3)
    assert goals_at(free_lengths(room(door=False), HEIGHT_M), 4.0).shape == (0, 2)


@pytest.mark.parametrize(
    ("point", "carried"), [((0.3, 0.2, 0.1), True), ((5, 0, 0), False), ((0.3, 0.2, 2.8), False)]
)
def test_a_floor_carries_near_its_templates_on_the_same_storey(point, carried):
    floor = Floor(np.array([[0.0, 0, 0], [1, 0, 0]]), spacing_m=0.5)
    assert floor.carries(np.array([point], float)).tolist() == [carried]
    assert not Floor(np.empty((0, 3)), 0.5).carries(np.zeros((1, 3))).any()
