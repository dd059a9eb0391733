"""Facts of a scan: the compiled ones against NumPy."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from firstfix import native
from firstfix.engine.diagnosis.facts import MEASURED
from firstfix.engine.diagnosis.viewpoint import PROBE_M, SUSPECT
from firstfix.scan.reduction import at_most
from firstfix.scan_file import read_scan_file
from tests.needs import recorded
from tests.reference import scan_facts as reference

SCANS = {
    "street": "kitti_drive0027_street/queries/key_frame_427.laz",
    "hall": "hilti_hall_indoor/queries/scan_044.pcd",
    "yard": "yard_vlp16_thin/queries/scan1525.pcd",
}


def assert_as_in_numpy(part: NDArray[np.float32]) -> int | None:
    """Compare all facts of some points. Returns the number of rings."""
    *plain, plane_ratio = native.scan_facts(part)
    *wanted, wanted_ratio = reference.scan_facts(part)
    assert plain == wanted
    if wanted_ratio is None:
        assert plane_ratio is None
    else:
        # eigenvalues in closed form are exact to some 1e-8 of the largest
        assert plane_ratio**2 == pytest.approx(wanted_ratio**2, rel=1e-5, abs=1e-7)
    assert native.is_spread_elsewhere(part, SUSPECT, PROBE_M) == reference.is_suspect(part)
    return plain[-1]


@pytest.mark.parametrize("place", SCANS)
def test_facts_of_recorded_scans(place: str):
    points = read_scan_file(recorded(SCANS[place])).points
    for away_m in (0.0, 2.0, 30.0):
        shifted = points + np.float32([away_m, -away_m / 3, 0])
        assert_as_in_numpy(at_most(shifted, MEASURED))


def test_facts_of_any_points():
    rng = np.random.default_rng(3)
    rings = set()
    for _ in range(200):
        count = int(rng.integers(1, MEASURED))
        points = rng.normal(size=(count, 3)) * rng.choice([0.01, 1, 30], 3)
        if rng.random() < 0.5:  # on the rings of a spinning sensor
            beams = rng.choice(np.linspace(-0.3, 0.3, int(rng.integers(1, 20))), count)
            points[:, 2] = np.hypot(points[:, 0], points[:, 1]) * beams
        rings.add(assert_as_in_numpy(points.astype(np.float32)))
    assert len(rings) > 5


def test_points_in_one_plane_have_no_thickness():
    rng = np.random.default_rng(4)
    flat = np.column_stack([rng.uniform(-9, 9, (300, 2)), np.full(300, 0.5)]).astype(np.float32)
    assert native.scan_facts(flat)[-1] < 1e-3


@pytest.mark.parametrize("wrong", [np.empty((0, 3), np.float32), np.full((5, 3), np.nan, np.float32)])
def test_points_that_are_none_are_refused(wrong: NDArray[np.float32]):
    with pytest.raises(ValueError, match=r"no points|not finite"):
        native.scan_facts(wrong)
    with pytest.raises(ValueError, match=r"no points|not finite"):
        native.is_spread_elsewhere(wrong, SUSPECT, PROBE_M)
