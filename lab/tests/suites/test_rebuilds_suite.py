"""The changed maps of the rebuilds suite."""

from __future__ import annotations

import numpy as np

from firstfix.sensor.model import SensorModel
from firstfix.transform import make_transform, rotation_z
from firstfix_cli.sample_world import World
from firstfix_lab.suites.rebuilds.changes import Change, changed_points

CHANGE = Change("part", "hall", 0.5, (4.0, 2.0), 0.45)


def world() -> World:
    """A run along y at a height of 1 m, and points all around it."""
    sensor = SensorModel("fan", (0.0,), 1.0, 0.1, 50.0, 1.0)
    run = np.array([make_transform(rotation_z(0.0), [10.0, y, 1.0]) for y in np.linspace(0, 20, 21)])
    cloud = np.random.default_rng(4).uniform([0, 0, 0], [20, 20, 3], (20_000, 3))
    return World("hall", 0, None, sensor, run, cloud, [])  # type: ignore[arg-type]


def test_what_stands_in_the_part_moves_along_the_run_and_nothing_else():
    place = world()
    points, moved = changed_points(place, CHANGE)
    x, y, z = place.cloud.T
    np.testing.assert_array_equal(moved, (abs(y - 10) < 2) & (abs(x - 10) < 1) & (z > 0.15))
    assert moved.any()
    expected = place.cloud + np.where(moved, 0.45, 0.0)[:, None] * [0, 1, 0]
    np.testing.assert_allclose(points, expected, atol=1e-12)
