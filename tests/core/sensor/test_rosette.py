"""A Mid-360's scan: what the vendor's table has in common with it."""

import numpy as np
import pytest

from firstfix.errors import InvalidOption
from firstfix.sensor import SensorModel, preset

MID_360 = preset("mid-360")
CELL_DEG = 3
# Firing, azimuth and elevation of the first beam, from Livox's table for simulators.
TABLE = [(0, 268.99, 52.16), (145, 85.4, 43.12), (288, 268.4, 48.2), (430, 80.2, 37.82), (1398, 259.5, 18.14)]
TABLE += [(1520, 96.4, 11.82), (2736, 266.0, 0.26), (2870, 86.9, -3.05)]


def angles_deg(rays):
    return np.degrees(np.arctan2(rays[:, 1], rays[:, 0])), np.degrees(np.arcsin(rays[:, 2].astype(float)))


def covered(moments):
    """(azimuth, elevation) which cells of the field of view have a ray."""
    azimuth, elevation = angles_deg(np.concatenate([MID_360.scan_directions(m) for m in moments]))
    edges = np.arange(-180, 181, CELL_DEG), np.arange(-6, 52, CELL_DEG)
    return np.histogram2d(azimuth, elevation, edges)[0] > 0


def test_a_scan_has_the_field_of_view_and_the_points_of_the_data_sheet():
    rays = MID_360.scan_directions(3)
    assert len(rays) == 20_000
    _, elevation = angles_deg(rays)
    assert elevation.min() == pytest.approx(-7, abs=0.5)
    assert elevation.max() == pytest.approx(52, abs=0.5)
    np.testing.assert_allclose(np.linalg.norm(rays, axis=1), 1, atol=1e-5)


def test_the_first_beam_is_where_the_vendors_table_has_it():
    azimuth, elevation = angles_deg(MID_360.scan_directions(0)[::4])
    for firing, azimuth_deg, elevation_deg in TABLE:
        off_deg = (azimuth[firing] - azimuth_deg + 180) % 360 - 180
        assert abs(off_deg) < 10, firing
        assert abs(elevation[firing] - elevation_deg) < 4, firing


def test_scans_fill_each_others_gaps():
    """One of 0.1 s leaves holes of some degrees, a second of ten scans hardly any."""
    one, ten = covered([0]), covered(range(10))
    assert 0.6 < one.mean() < 0.95
    assert ten.mean() > 0.98
    assert not np.array_equal(covered([1]), one)


def test_it_is_no_stack_of_rows():
    _, elevation = angles_deg(MID_360.scan_directions(0))
    assert len(np.unique(elevation.round(2))) > 3000
    assert len(np.unique(angles_deg(MID_360.directions())[1].round(2))) == 40


def test_a_coarser_model_for_templates_looks_over_the_same_field():
    low, high = angles_deg(MID_360.coarser(4000).directions())[1][[0, -1]]
    assert (low, high) == pytest.approx((-7, 52), abs=0.01)


def test_a_spinning_sensor_scans_its_rows():
    spinning = preset("vlp-16")
    assert spinning.moments == 1
    assert np.array_equal(spinning.scan_directions(), spinning.directions())


def test_no_other_pattern():
    with pytest.raises(InvalidOption, match="pattern"):
        SensorModel.from_mapping({"preset": "mid-360", "pattern": "spiral"})
