"""An intensity in the place of x is told by its numbers, and no right scan is taken for one."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from numpy.typing import NDArray

from firstfix.answer.options import LocalizeOptions
from firstfix.engine.config import PreprocessConfig
from firstfix.engine.diagnosis.facts import MEASURED, facts_of, is_intensity_first
from firstfix.engine.diagnosis.input_findings import input_finding
from firstfix.engine.diagnosis.other_forms import other_forms
from firstfix.scan.reduction import at_most
from firstfix.scan.scan import Scan
from firstfix.scan_file import read_scan_file
from firstfix.sensor import preset, presets
from firstfix.wire.scan import decode_scan, encode_scan
from tests.needs import RECORDED, of_recordings
from tests.recorded_data import GARAGE, HALL, STREET, STREET_128, YARD

Points = NDArray[np.float32]
RNG = np.random.default_rng(7)
SOME = 10 * MEASURED  # of the points of a scan: enough for its windows
WIDTHS_DEG = (240, 180, 120, 90, 60)
HEADINGS_DEG = range(-180, 180, 45)
FOLDERS = [place.folder for place in (HALL, STREET, YARD, GARAGE, STREET_128)]
FOLDERS += ["strangers", "rotation_in_place_11"]


def room(sensor: str, ahead_m: float = 8.0) -> Points:
    """Points of a sensor in a box, with a wall at a whole number of metres ahead."""
    rays = preset(sensor).directions().astype(np.float64)
    rays[np.abs(rays) < 1e-9] = 1e-9
    walls = np.where(rays > 0, [ahead_m, 5.0, 3.0], [-8.0, -5.0, -1.0]) / rays
    return (rays * walls.min(axis=1)[:, None]).astype(np.float32)


def shifted(points: Points, first: NDArray[np.generic]) -> Scan:
    """The scan of rows of (n,) numbers, x, y and z, whose first three columns are taken as x, y, z."""
    return Scan.from_points(np.column_stack([first, points[:, :2]]), intensity=points[:, 2])


def found(scan: Scan) -> str | None:
    part = at_most(scan.points, MEASURED)
    finding = input_finding(facts_of(scan, part, scan.dropped, PreprocessConfig()), part, scan.dropped)
    return None if finding is None else finding.code


def windows(points: Points) -> Iterator[Points]:
    """The scan, and its parts of the turn, each also turned so that it looks forward."""
    yield points
    points = at_most(points, SOME)
    azimuth_deg = np.degrees(np.arctan2(points[:, 1], points[:, 0]))
    for heading_deg in HEADINGS_DEG:
        c, s = np.cos(np.radians(heading_deg)), np.sin(np.radians(heading_deg))
        ahead = points @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]], np.float32)
        for width_deg in WIDTHS_DEG:
            within = np.abs((azimuth_deg - heading_deg + 180) % 360 - 180) < width_deg / 2
            yield points[within]
            yield ahead[within]


def is_named(points: Points) -> bool:
    return is_intensity_first(at_most(points, MEASURED))


@pytest.mark.parametrize("form", ["points", "range_image"])
def test_columns_of_whole_numbers_are_named(form: str):
    points = room("os1-64")
    for name, first in {
        "intensities, most of them beyond the range": RNG.integers(0, 256, len(points)),
        "reflectances": RNG.geometric(0.05, len(points)),
        "rings": np.arange(len(points)) % 64,
    }.items():
        sent = decode_scan(encode_scan(shifted(points, first), form=form))
        assert found(sent) == "columns_shifted", name


def test_intensities_from_0_to_1_are_left_to_the_form_that_fits():
    points = room("os1-64")
    scan = shifted(points, RNG.integers(0, 256, len(points)) / 255)
    assert found(scan) is None
    tried = next(other_forms(scan, LocalizeOptions(), None, 1.0))
    np.testing.assert_allclose(tried.change(scan).points, points, atol=1e-6)


def test_right_scans_are_not_named():
    for sensor in presets():
        for ahead_m in (3.0, 8.0):
            assert not any(is_named(part) for part in windows(room(sensor, ahead_m))), (sensor, ahead_m)


def test_a_grid_of_metres_is_no_intensity():
    grid = np.stack(np.meshgrid(np.arange(1, 30), np.arange(-15, 15), np.arange(3)), axis=-1).reshape(-1, 3)
    assert not is_named(grid.astype(np.float32))
    assert not is_named(np.empty((0, 3), np.float32))


def recorded_scans() -> dict[str, Scan]:
    files = [
        path
        for folder in FOLDERS
        for path in sorted((RECORDED / folder).rglob("*"))
        if path.suffix in (".pcd", ".laz", ".bin") and not path.name.startswith("map_")
    ]
    if not files:
        pytest.skip(of_recordings(HALL.folder))
    return {str(path.relative_to(RECORDED)): read_scan_file(path) for path in files}


def test_recorded_scans_are_named_where_their_intensity_stands_first_only():
    scans = recorded_scans()
    assert not [name for name, scan in scans.items() if any(map(is_named, windows(scan.points)))]
    for name, scan in scans.items():
        if scan.intensity is not None and np.ptp(scan.intensity) > 0:
            for form in ("points", "range_image"):
                sent = decode_scan(encode_scan(shifted(scan.points, scan.intensity), form=form))
                assert found(sent) == "columns_shifted", (name, form)
