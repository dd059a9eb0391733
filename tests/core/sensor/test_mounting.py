"""The mounting of a sensor: where its rays go on a robot that stands level."""

from dataclasses import replace

import numpy as np
import pytest

from firstfix.answer.options import LocalizeOptions
from firstfix.errors import InvalidOption
from firstfix.sensor import SensorModel, preset

MID_360 = preset("mid-360")


def elevations_deg(directions):
    return np.degrees(np.arcsin(directions[:, 2]))


def test_an_upright_sensor_looks_where_it_looks_to_the_last_bit():
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


def test_roll_and_pitch_mean_what_they_mean_in_a_query():
    hanging = replace(MID_360, mount_roll_deg=150.0, mount_pitch_deg=-20.0)
    down = LocalizeOptions.from_strings({"gravity": "150,-20"}).gravity
    np.testing.assert_allclose(hanging.R_base_sensor.T @ [0, 0, -1], down, atol=1e-12)


def test_the_mounting_is_read_from_a_mapping_and_kept_by_what_is_coarser():
    hanging = SensorModel.from_mapping({"preset": "mid-360", "mount_roll_deg": 180})
    assert hanging.mount_roll_deg == 180
    assert SensorModel.from_mapping(hanging.to_mapping()) == hanging
    assert hanging.coarser(2000).mount_roll_deg == 180


@pytest.mark.parametrize("wrong", [{"mount_roll_deg": 181}, {"mount_pitch_deg": float("nan")}])
def test_no_other_angles(wrong):
    with pytest.raises(InvalidOption, match="out of range"):
        SensorModel.from_mapping({"preset": "mid-360", **wrong})
