"""Points of a map as a sensor sees them from a place."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from firstfix.sensor import SensorModel
from firstfix_builder.quick.sensor_view import SensorView
from tests.small_world import SENSOR

VIEW = SensorView.of(SensorModel.from_mapping(SENSOR))


def wall(x_m: float, half_width_m: float) -> np.ndarray:
    y, z = np.meshgrid(np.arange(-half_width_m, half_width_m, 0.05), np.arange(-0.5, 0.5, 0.05))
    return np.column_stack([np.full(y.size, x_m), y.ravel(), z.ravel()]).astype(np.float32)


def test_a_wall_hides_what_is_behind_it():
    near, behind, beside = wall(4.0, 1.0), wall(8.0, 1.0), wall(-6.0, 1.0)
    seen = VIEW.seen(np.concatenate([near, behind, beside]))
    assert set(np.unique(seen[:, 0])) == {-6.0, 4.0}
    assert len(seen) == len(near) + len(beside)


@pytest.mark.parametrize("elevation_deg", [-60.0, 60.0])
def test_a_point_above_or_below_the_field_of_view_is_not_seen(elevation_deg):
    angle = np.radians(elevation_deg)
    points = np.array([[5 * np.cos(angle), 0, 5 * np.sin(angle)], [5.0, 0.0, 0.0]], np.float32)
    assert VIEW.seen(points).tolist() == [[5.0, 0.0, 0.0]]


def test_a_point_nearer_or_further_than_the_sensor_measures_is_not_seen():
    narrow = replace(VIEW, min_range_m=1.0, max_range_m=10.0)
    points = np.array([[0.5, 0, 0], [0, 5.0, 0], [-20.0, 0, 0]], np.float32)
    assert narrow.seen(points).tolist() == [[0.0, 5.0, 0.0]]


def test_no_points_are_seen_of_none():
    assert VIEW.seen(np.zeros((0, 3), np.float32)).shape == (0, 3)
