"""Mirror images as negatives: not in the map, unless a place is symmetric."""

import numpy as np
import pytest

from firstfix.scan.scan import Scan
from firstfix.sensor import SensorModel
from firstfix.transform import make_transform, rotation_z
from firstfix_builder.self_test.equal_places import is_in_map, mirrored
from firstfix_builder.simulation.boxes import Boxes
from firstfix_builder.simulation.simulate import Simulator

ELEVATIONS = tuple(np.linspace(-20, 20, 9).tolist())
SENSOR = SensorModel("rings", ELEVATIONS, 2.0, 0.1, 60.0, 0.8)
ON_ITS_SIDE = SensorModel("on its side", ELEVATIONS, 2.0, 0.1, 60.0, 0.8, mount_roll_deg=90.0)
SHELF = ([3.0, 2.5, 1.0], [0.3, 1.4, 1.0])


def room(*things: tuple[list[float], list[float]]) -> Simulator:
    centre, half = zip(([0.0, 0.0, 1.5], [6.0, 4.0, 1.5]), *things, strict=True)
    return Simulator(*Boxes(np.array(centre), np.array(half), np.zeros(len(centre))).mesh())


@pytest.mark.parametrize("sensor", [SENSOR, ON_ITS_SIDE], ids=lambda sensor: sensor.name)
def test_left_and_right_of_the_robot_are_exchanged_and_up_stays(sensor: SensorModel):
    points = np.random.default_rng(0).normal(size=(50, 3)).astype(np.float32)
    image = mirrored(Scan.from_points(points), sensor).points
    on_robot, image_on_robot = points @ sensor.R_base_sensor.T, image @ sensor.R_base_sensor.T
    assert np.allclose(image_on_robot, on_robot * [1, -1, 1], atol=1e-5)


@pytest.mark.parametrize("sensor", [SENSOR, ON_ITS_SIDE], ids=lambda sensor: sensor.name)
def test_the_image_of_a_symmetric_place_is_in_the_map(sensor: SensorModel):
    """A scan at (x, y, yaw) of a room that is its own image about y = 0 has its image at (x, -y, -yaw)."""
    at = make_transform(rotation_z(0.5) @ sensor.R_base_sensor, [1.0, 0.8, 0.8])
    image = make_transform(rotation_z(-0.5) @ sensor.R_base_sensor, [1.0, -0.8, 0.8])
    beside = make_transform(rotation_z(-0.5) @ sensor.R_base_sensor, [3.0, -2.0, 0.8])
    both_sides = room(SHELF, ([3.0, -2.5, 1.0], [0.3, 1.4, 1.0]))
    assert is_in_map(room(), sensor, at, image)
    assert is_in_map(both_sides, sensor, at, image)
    assert not is_in_map(room(), sensor, at, beside)


def test_the_image_of_a_place_with_a_shelf_on_one_side_is_not():
    wide = ([2.0, 2.0, 1.4], [2.5, 1.0, 1.4])
    at = make_transform(rotation_z(0.5), [-1.5, 0.2, 0.8])
    image = make_transform(rotation_z(-0.5), [-1.5, -0.2, 0.8])
    assert not is_in_map(room(wide), SENSOR, at, image)
