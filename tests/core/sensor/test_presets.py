"""Presets against their vendors' data sheets: beams, field of view, points of a scan."""

import re
from pathlib import Path

import numpy as np
import pytest

from firstfix.errors import InvalidOption
from firstfix.sensor import SensorModel, preset, presets

# beams, lowest and highest elevation, columns
SHEETS = {
    "vlp-16": (16, -15, 15, 1800),
    "hdl-32e": (32, -30.67, 10.67, 1800),
    "hdl-64e": (64, -24.33, 2, 1800),
    "os0-32": (32, -45, 45, 1024),
    "os0-64": (64, -45, 45, 1024),
    "os0-128": (128, -45, 45, 1024),
    "os1-32": (32, -22.5, 22.5, 1024),
    "os1-64": (64, -22.5, 22.5, 1024),
    "os1-128": (128, -22.5, 22.5, 1024),
    "xt16": (16, -15, 15, 2000),
    "xt32": (32, -16, 15, 2000),
    "qt64": (64, -52.13, 52.13, 600),
    "qt128": (128, -52.63, 52.63, 900),
    "pandar64": (64, -25.07, 14.71, 1800),
    "mid-360": (40, -7, 52, 500),
}


def test_the_data_sheets_are_those_of_all_presets():
    assert presets() == sorted(SHEETS)


@pytest.mark.parametrize("name", SHEETS)
def test_a_preset_is_as_its_data_sheet_says(name):
    beams, low_deg, high_deg, columns = SHEETS[name]
    sensor = preset(name)
    assert sensor.name == name
    assert len(set(sensor.elevations_deg)) == len(sensor.elevations_deg) == beams
    assert (min(sensor.elevations_deg), max(sensor.elevations_deg)) == pytest.approx(
        (low_deg, high_deg), abs=0.01
    )
    assert sensor.directions().shape == sensor.scan_directions().shape == (beams * columns, 3)
    assert SensorModel.from_mapping(sensor.to_mapping()) == sensor


@pytest.mark.parametrize(
    ("name", "widest_deg"), [("qt64", 2.4), ("qt128", 1.61), ("hdl-64e", 0.51), ("xt16", 2.01)]
)
def test_no_beam_of_a_table_is_missing(name, widest_deg):
    gaps = np.diff(np.sort(preset(name).elevations_deg))
    assert gaps.min() > 0.05
    assert gaps.max() < widest_deg


def test_a_name_is_read_in_any_case_and_another_is_refused():
    assert preset("OS1-64") == preset("os1-64")
    with pytest.raises(InvalidOption, match="no sensor preset"):
        preset("os3-64")


def test_the_tutorial_lists_all_presets():
    tutorial = Path(__file__).resolve().parents[3] / "docs/tutorials/your-own-map.md"
    listed = tutorial.read_text().split("There are presets:")[1].split("Any of these")[0]
    assert sorted(re.findall(r"`([^`]+)`", listed)) == presets()
