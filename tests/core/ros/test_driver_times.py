"""The times of each driver's clouds, against the true ones."""

from __future__ import annotations

import numpy as np

from firstfix.decode import decode_query
from firstfix.ros.media_types import POINT_CLOUD2
from tests.driver_clouds import LAYOUTS, PERIOD_S
from tests.every_case import every_case


@every_case("driver", LAYOUTS)
def test_the_times_of_each_driver_are_the_true_ones(driver):
    layout = LAYOUTS[driver]
    points = np.random.default_rng(0).uniform(3, 20, (2000, 3))
    since_begin_s = np.repeat(np.linspace(0, 0.0999, 125), 16)
    scan = decode_query(layout.message(points, since_begin_s), POINT_CLOUD2)
    back = (scan.points != 0).any(axis=1)
    np.testing.assert_allclose(scan.points[back], points, rtol=1e-6)
    np.testing.assert_allclose(scan.time_s[back], layout.truth_s(since_begin_s), atol=layout.resolution_s)
    assert np.abs(scan.time_s).max() <= PERIOD_S + 1e-6
    assert scan.time_field.unit is not None
