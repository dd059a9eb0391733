"""Presets against their vendors' data sheets: beams, field of view, points of a scan."""

from pathlib import Path

import numpy as np
import pytest

from firstfix.errors import InvalidOption
from firstfix.sensor import SensorModel, preset, presets

# beams, lowest and highest elevation, columns of a scan, horizontal field of view, range
SHEETS = {
    "vlp-16": (16, -15, 15, 1800, 360, 0.5, 100),
    "puck-hi-res": (16, -10, 10, 1800, 360, 0.5, 100),
    "vlp-32c": (32, -25, 15, 1800, 360, 0.4, 200),
    "hdl-32e": (32, -30.67, 10.67, 1800, 360, 1.0, 100),
    "hdl-64e": (64, -24.33, 2, 1800, 360, 1.5, 120),
    "vls-128": (128, -25, 15, 1800, 360, 0.4, 200),
    "os0-32": (32, -45, 45, 1024, 360, 0.3, 50),
    "os0-64": (64, -45, 45, 1024, 360, 0.3, 50),
    "os0-128": (128, -45, 45, 1024, 360, 0.3, 50),
    "os1-32": (32, -22.5, 22.5, 1024, 360, 0.3, 120),
    "os1-64": (64, -22.5, 22.5, 1024, 360, 0.3, 120),
    "os1-128": (128, -22.5, 22.5, 1024, 360, 0.3, 120),
    "os2-32": (32, -11.25, 11.25, 1024, 360, 1.0, 240),
    "os2-64": (64, -11.25, 11.25, 1024, 360, 1.0, 240),
    "os2-128": (128, -11.25, 11.25, 1024, 360, 1.0, 240),
    "osdome-32": (32, 0, 87.2, 1024, 360, 0.5, 45),
    "osdome-64": (64, 0, 88.6, 1024, 360, 0.5, 45),
    "osdome-128": (128, 0, 89.3, 1024, 360, 0.5, 45),
    "xt16": (16, -15, 15, 2000, 360, 0.3, 120),
    "xt32": (32, -16, 15, 2000, 360, 0.3, 120),
    "qt64": (64, -52.13, 52.13, 600, 360, 0.1, 60),
    "qt128": (128, -52.63, 52.63, 900, 360, 0.05, 50),
    "jt16": (16, 0.604, 40.664, 600, 360, 0.1, 30),
    "jt128": (128, -4.965, 88.865, 900, 360, 0.1, 30),
    "pandar64": (64, -25.07, 14.71, 1800, 360, 0.3, 200),
    "rs-helios-16p": (16, -15, 15, 1800, 360, 0.2, 110),
    "rs-helios-1610": (32, -16, 10, 1800, 360, 0.2, 110),
    "rs-helios-1615": (32, -16, 15, 1800, 360, 0.2, 110),
    "rs-helios-5515": (32, -55.02, 15, 1800, 360, 0.2, 110),
    "rs-airy": (96, 0, 89.5, 900, 360, 0.1, 60),
    "rs-e1r": (144, -45, 45, 192, 120, 0.1, 30),
    "mid-360": (40, -7, 52, 500, 360, 0.1, 70),
    "mid-70": (40, -35.2, 35.2, 250, 70.4, 0.05, 130),
    "avia": (40, -38.6, 38.6, 600, 70.4, 0.1, 200),
    "hap": (40, -12.5, 12.5, 1130, 120, 0.5, 150),
    "unitree-l1": (30, 0, 89, 72, 360, 0.05, 30),
    "unitree-l2": (32, 0, 89, 200, 360, 0.05, 30),
}
RAYS_A_SECOND = {  # as the sheets give them; a preset has those of 0.1 s
    "mid-360": 200_000,
    "mid-70": 100_000,
    "avia": 240_000,
    "hap": 452_000,
    "rs-e1r": 260_000,
    "unitree-l1": 21_600,
    "unitree-l2": 64_000,
}


def test_every_preset_has_a_data_sheet():
    assert presets() == sorted(SHEETS)


@pytest.mark.parametrize("name", SHEETS)
def test_a_preset_agrees_with_its_data_sheet(name):
    beams, low_deg, high_deg, columns, fov_deg, least_m, most_m = SHEETS[name]
    sensor = preset(name)
    assert sensor.name == name
    assert len(set(sensor.elevations_deg)) == len(sensor.elevations_deg) == beams
    assert (min(sensor.elevations_deg), max(sensor.elevations_deg)) == pytest.approx(
        (low_deg, high_deg), abs=0.01
    )
    assert (sensor.azimuth_fov_deg, sensor.min_range_m, sensor.max_range_m) == (fov_deg, least_m, most_m)
    scan = sensor.scan_directions()
    assert scan.shape == (beams * columns, 3)
    assert sensor.directions().shape == (round(beams * columns * 360 / fov_deg), 3) or fov_deg < 360
    azimuth_deg = np.degrees(np.arctan2(scan[:, 1], scan[:, 0]))
    assert np.abs(azimuth_deg).max() <= fov_deg / 2 + 1e-3
    assert np.ptp(azimuth_deg) == pytest.approx(fov_deg, rel=0.02)
    assert SensorModel.from_mapping(sensor.to_mapping()) == sensor


@pytest.mark.parametrize("name", RAYS_A_SECOND)
def test_a_sensor_of_no_columns_has_as_many_rays_as_its_sheet_says(name):
    assert len(preset(name).scan_directions()) == pytest.approx(RAYS_A_SECOND[name] / 10, rel=0.07)


def test_a_narrow_sensor_looks_ahead_and_its_templates_all_around():
    narrow = preset("rs-e1r")
    assert narrow.directions()[:, 0].min() < -0.9
    assert narrow.scan_directions()[:, 0].min() > 0
    assert narrow.coarser(4000).azimuth_fov_deg == 120


@pytest.mark.parametrize(
    ("name", "wrong", "says"),
    [
        *(
            ("vlp-16", {"azimuth_fov_deg": fov_deg}, "azimuth_fov_deg")
            for fov_deg in (0, -90, 361, float("nan"))
        ),
        ("mid-360", {"mount_roll_deg": 181}, "out of range"),
        ("mid-360", {"mount_pitch_deg": float("nan")}, "out of range"),
        ("mid-360", {"pattern": "spiral"}, "pattern"),
    ],
)
def test_invalid_values_are_refused(name, wrong, says):
    with pytest.raises(InvalidOption, match=says):
        SensorModel.from_mapping({"preset": name, **wrong})


def test_the_reference_page_has_all_presets_with_their_numbers():
    page = (Path(__file__).resolve().parents[3] / "docs/reference/sensors.md").read_text()
    rows = {
        row[0].strip("` "): row[1:] for row in (line.strip("| ").split(" | ") for line in page.splitlines())
    }
    assert {name for name in rows if name in SHEETS} == set(SHEETS)
    for name, (beams, low_deg, high_deg, _, fov_deg, least_m, most_m) in SHEETS.items():
        told = [cell.strip() for cell in rows[name][:4]]
        pattern = str(beams) if preset(name).pattern == "rows" else "rosette"
        assert told == [pattern, f"{low_deg:g} to {high_deg:g}", f"{fov_deg:g}", f"{least_m:g} to {most_m:g}"]


@pytest.mark.parametrize(
    ("name", "widest_deg"),
    [("qt64", 2.4), ("qt128", 1.61), ("hdl-64e", 0.51), ("xt16", 2.01), ("jt128", 1.8), ("vls-128", 5.42)],
)
def test_tables_of_beams_have_no_gaps(name, widest_deg):
    gaps = np.diff(np.sort(preset(name).elevations_deg))
    assert gaps.min() > (0 if name == "jt128" else 0.05)  # two of its beams lie 0.001 apart
    assert gaps.max() < widest_deg


def test_a_name_is_read_in_any_case_and_another_is_refused():
    assert preset("OS1-64") == preset("os1-64")
    with pytest.raises(InvalidOption, match="no sensor preset"):
        preset("os3-64")
