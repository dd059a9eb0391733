"""One compiled call prepares a scan: to the last bit what its steps give one by one."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from firstfix.bit_exact.accelerated import REFERENCES
from firstfix.engine.config import OccupancyConfig, PreprocessConfig
from firstfix.engine.preprocess import PreparedQuery, preprocess
from firstfix.engine.ranking import RANKING
from firstfix.engine.registration.surface import Surface
from firstfix.native import range_view
from firstfix.scan.compact import CompactScan
from firstfix.scan.condense import condense
from firstfix.scan.descriptor_parameters import DescriptorParameters
from firstfix.scan.levelling import levelling_rotation
from firstfix.scan.reduction import COLUMNS, ROWS
from firstfix.scan.scan import Scan
from firstfix.scan.sequence import ScanSequence
from firstfix.scan_file import read_scan_file
from tests.every_case import every_case
from tests.needs import recorded
from tests.reference.preprocess import prepared

UP = np.array([0.0, 0.0, 1.0])
GRAVITY = np.array([0.3, -0.2, -9.7])
CONFIG = PreprocessConfig()
SCANS = {
    "street": "kitti_drive0027_street/queries/key_frame_427.laz",
    "hall": "hilti_hall_indoor/queries/scan_044.pcd",
    "yard": "yard_vlp16_thin/queries/scan1525.pcd",
}


@cache
def scan(place: str) -> Scan:
    return read_scan_file(recorded(SCANS[place]))


def timed(whole: Scan, sweep_s: float = 0.1) -> Scan:
    azimuth = np.arctan2(whole.points[:, 1], whole.points[:, 0])
    return replace(whole, time_s=(azimuth / (2 * np.pi) * sweep_s).astype(np.float32))


def alike(one: Any, other: Any) -> bool:
    """Whether two results are the same to the last bit."""
    if one is None or other is None:
        return one is other
    if hasattr(one, "__dataclass_fields__"):
        return all(alike(getattr(one, name), getattr(other, name)) for name in one.__dataclass_fields__)
    if isinstance(one, np.ndarray):
        return one.dtype == other.dtype and np.array_equal(one, other, equal_nan=True)
    return bool(one == other)


def check(one: Scan | CompactScan, config: PreprocessConfig = CONFIG, **how: Any) -> PreparedQuery | None:
    """Prepare a scan, and compare it with the reference."""
    found = preprocess(
        ScanSequence.single(one), config=config, gravity=how.get("gravity"), R_base_sensor=how.get("R")
    )
    gravity, R = how.get("gravity"), how.get("R")
    up = UP if R is None else R[2]
    known = {"up_is_known": gravity is not None}
    wanted = prepared(one, up if gravity is None else -gravity, config, RANKING, **known)
    assert (found is None) == (wanted is None)
    if found is None or wanted is None:
        return None
    (made,) = found.scans
    # without times, nothing is deskewed
    if wanted.thinned.time_s is None:
        wanted = replace(wanted, returns=None)
    for name in made.__dataclass_fields__:
        assert alike(getattr(made, name), getattr(wanted, name)), name
    assert alike(found.dense, wanted.thinned)
    assert alike(found.sparse, wanted.thinned.at_most(RANKING.sparse_points, config.voxel_m))
    return found


HOW: dict[str, dict[str, Any]] = {
    "by its surfaces": {},
    "by gravity": {"gravity": GRAVITY},
    "as it is mounted": {"R": levelling_rotation(np.array([0.4, -0.3, 0.8]))},
    "head down": {"R": np.diag([1.0, -1.0, -1.0])},
}


@pytest.mark.parametrize("place", SCANS)
def test_a_recorded_scan_is_prepared_as_step_by_step(place: str):
    whole = scan(place)
    described = condense(whole, DescriptorParameters(descriptor=OccupancyConfig().make()))
    for how in HOW.values():
        for one in (whole, timed(whole), condense(whole), condense(timed(whole)), described):
            assert check(one, **how) is not None
    assert (
        check(whole, PreprocessConfig(min_range_m=3.0, max_range_m=25.0, voxel_m=0.4, min_points=10))
        is not None
    )


def test_times_of_a_flash_show_no_motion():
    found = check(timed(scan("yard"), sweep_s=0.004))
    assert found is not None
    assert found.dense.time_s is None
    assert found.scans[0].returns is None


METRES = st.one_of(
    st.sampled_from([0.0, -0.0, 0.25, 0.5, -0.5, 1.7, 5.0, 100.0]),  # equal points, lines, edges
    st.floats(-120, 120, width=32),
)
CLOUD = arrays(np.float32, st.tuples(st.integers(0, 60), st.just(3)), elements=METRES)
FEW = PreprocessConfig(min_points=10)


@settings(max_examples=120)
@given(CLOUD, st.sampled_from(sorted(HOW)), st.booleans())
def test_any_points_are_prepared_as_step_by_step(points: NDArray[np.float32], how: str, is_timed: bool):
    one = Scan(points)
    check(timed(one) if is_timed else one, FEW, **HOW[how])
    check(condense(timed(one) if is_timed else one, points=40), FEW, **HOW[how])


@settings(max_examples=60)
@given(
    arrays(np.float32, ROWS * COLUMNS, elements=st.floats(0, 90, width=32), fill=st.just(np.float32(np.inf)))
)
def test_the_view_of_any_ranges(nearest_m: NDArray[np.float32]):
    for found, wanted in zip(range_view(nearest_m), REFERENCES["range_view"](nearest_m), strict=True):
        np.testing.assert_array_equal(found, wanted)


@every_case("filled", [0.0, 0.02, 0.3, 0.8, 0.97, 1.0])
def test_the_view_of_ranges_with_holes(filled: float):
    rng = np.random.default_rng(int(100 * filled))
    nearest_m = rng.uniform(0.3, 90, ROWS * COLUMNS).astype(np.float32)
    nearest_m[rng.random(len(nearest_m)) >= filled] = np.inf
    for found, wanted in zip(range_view(nearest_m), REFERENCES["range_view"](nearest_m), strict=True):
        np.testing.assert_array_equal(found, wanted)


def test_several_scans_share_their_points():
    whole, T = scan("hall"), np.eye(4)
    T[:3, 3] = 1.0, 0.2, 0.0
    sequence = ScanSequence((whole, timed(whole)), (T, np.eye(4)))
    found = preprocess(sequence, None, CONFIG)
    assert found is not None
    surfaces = [one.thinned.moved(one.T_last_scan) for one in found.scans]
    together = Surface.together(surfaces)
    assert alike(found.dense, together.at_most(RANKING.dense_points, CONFIG.voxel_m))
    assert alike(found.sparse, together.at_most(RANKING.sparse_points, CONFIG.voxel_m))
    assert found.scans[0].thinned.time_s is None
