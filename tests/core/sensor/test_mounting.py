"""Where the rays of a sensor go: on a robot that stands level, and in the rosette of a Mid-360."""

from dataclasses import replace

import numpy as np
import pytest

from firstfix.answer.options import LocalizeOptions
from firstfix.sensor import SensorModel, preset

MID_360 = preset("mid-360")


def elevations_deg(directions):
    return np.degrees(np.arcsin(directions[:, 2].astype(float)))


def test_an_upright_mounting_changes_no_bit():
    assert np.array_equal(MID_360.directions_at_any_heading(), MID_360.directions())


@pytest.mark.parametrize("mounted", [{"mount_roll_deg": 180.0}, {"mount_pitch_deg": 180.0}])
def test_head_down_the_elevations_look_from_the_other_side(mounted):
    hanging = replace(MID_360, **mounted)
    upright, down = MID_360.directions(), hanging.directions_at_any_heading()
    np.testing.assert_allclose(elevations_deg(down), -elevations_deg(upright), atol=1e-3)
    assert elevations_deg(down).min() == pytest.approx(-52, abs=0.01)
    assert elevations_deg(down).max() == pytest.approx(7, abs=0.01)


@pytest.mark.parametrize("name", ["mid-360", "vlp-16", "os0-64"])
@pytest.mark.parametrize("mounted", [{"mount_roll_deg": 90.0}, {"mount_pitch_deg": -90.0}])
def test_a_sensor_on_its_side_is_looked_at_from_all_headings_with_as_many_rays(name, mounted):
    on_its_side = replace(preset(name), **mounted)
    rays = on_its_side.directions_at_any_heading()
    assert rays.shape == preset(name).directions().shape
    np.testing.assert_allclose(np.linalg.norm(rays, axis=1), 1, atol=1e-5)
    ahead = np.abs(elevations_deg(rays)) < 15
    azimuth_deg = np.degrees(np.arctan2(rays[ahead, 1], rays[ahead, 0]))
    seen = np.histogram(azimuth_deg, np.arange(-180, 181, 10))[0]
    assert seen.min() > 0
    assert elevations_deg(rays).min() < -60
    assert elevations_deg(rays).max() > 60


def test_roll_and_pitch_are_those_of_a_query():
    hanging = replace(MID_360, mount_roll_deg=150.0, mount_pitch_deg=-20.0)
    down = LocalizeOptions.from_strings({"gravity": "150,-20"}).gravity
    np.testing.assert_allclose(hanging.R_base_sensor.T @ [0, 0, -1], down, atol=1e-12)


def test_a_coarser_model_keeps_the_mounting():
    hanging = SensorModel.from_mapping({"preset": "mid-360", "mount_roll_deg": 180})
    assert hanging.mount_roll_deg == 180
    assert SensorModel.from_mapping(hanging.to_mapping()) == hanging
    assert hanging.coarser(2000).mount_roll_deg == 180


CELL_DEG = 3
# Firing, azimuth and elevation of the first beam, from Livox's table for simulators.
TABLE = [(0, 268.99, 52.16), (145, 85.4, 43.12), (288, 268.4, 48.2), (430, 80.2, 37.82), (1398, 259.5, 18.14)]
TABLE += [(1520, 96.4, 11.82), (2736, 266.0, 0.26), (2870, 86.9, -3.05)]


def angles_deg(rays):
    return np.degrees(np.arctan2(rays[:, 1], rays[:, 0])), elevations_deg(rays)


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


def test_a_rosette_is_no_stack_of_rows():
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
