"""Ways to level a scan near the first one."""

from __future__ import annotations

import numpy as np
import pytest

from firstfix.engine.config import PreprocessConfig
from firstfix.engine.preprocess import PreparedQuery, PreparedScan, preprocess
from firstfix.engine.registration.surface import Surface
from firstfix.scan.scan import Scan
from firstfix.scan.sequence import ScanSequence
from firstfix.transform import make_transform
from tests.reference import level_hypotheses as reference
from tests.reference.level_hypotheses import TILT_DEG, TILTS, ground_normal, tilts
from tests.reference.levelled_otherwise import levelled_otherwise

Z = np.array([0.0, 0.0, 1.0])
SLOPE = np.array([np.sin(np.radians(12)), 0, np.cos(np.radians(12))])


def slope_with_posts(seed: int = 0) -> np.ndarray:
    """Points of a plane that falls along x under a sensor 1.5 m above it, and of upright posts."""
    rng = np.random.default_rng(seed)
    xy = rng.uniform(-12, 12, (6000, 2))
    ground = np.column_stack([xy, -1.5 - xy[:, 0] * SLOPE[0] / SLOPE[2]])
    angle, at = rng.uniform(0, 2 * np.pi, 3000), rng.uniform(-10, 10, (6, 2))[rng.integers(6, size=3000)]
    posts = np.column_stack(
        [at + 0.4 * np.column_stack([np.cos(angle), np.sin(angle)]), rng.uniform(-2, 3, 3000)]
    )
    return np.concatenate([ground, posts]) + rng.normal(0, 0.01, (9000, 3))


@pytest.fixture(scope="module")
def prepared() -> PreparedQuery:
    scan = Scan.from_points(slope_with_posts())
    found = preprocess(ScanSequence.single(scan), None, PreprocessConfig())
    assert found is not None
    return found


def level_hypotheses(
    prepared: PreparedQuery, expected_up: np.ndarray | None, usual_height_m: float, *, tilted: bool
) -> tuple[PreparedScan, ...]:
    """The compiled ways, which are those of the reference."""
    asked = prepared, expected_up, usual_height_m
    found = levelled_otherwise(*asked, tilted=tilted)
    wanted = reference.level_hypotheses(*asked, tilted=tilted)
    assert len(found) == len(wanted)
    for mine, its in zip(found, wanted, strict=True):
        assert mine.T_last_scan is its.T_last_scan
        np.testing.assert_allclose(mine.R_level_sensor, its.R_level_sensor, rtol=0, atol=1e-6)
        assert mine.height_m == pytest.approx(its.height_m, abs=1e-4)
    return found


def off_deg(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.degrees(np.arccos(np.clip(a @ b, -1, 1))))


def test_the_ground_s_normal_is_that_of_the_slope(prepared):
    assert off_deg(ground_normal(prepared.dense, Z), SLOPE) < 2
    empty = Surface(*(np.empty((0, 3), np.float32) for _ in range(2)), np.empty(0, np.bool_))
    assert ground_normal(empty, Z).tolist() == Z.tolist()


def test_the_mounting_and_the_slope_are_tried_beside_the_estimate(prepared):
    ways = level_hypotheses(prepared, Z, usual_height_m=0.6, tilted=False)
    ups = [way.up for way in ways]
    for up in (prepared.scans[0].up, Z, SLOPE):
        assert min(off_deg(up, other) for other in ups) < 2.1
    assert all(way.described is None for way in ways)
    assert {round(way.height_m, 1) for way in ways} > {0.6}, "the map's own height, and the one that is seen"


def test_ups_that_are_nearly_the_same_are_tried_once(prepared):
    ways = level_hypotheses(prepared, prepared.scans[0].up, usual_height_m=1.5, tilted=True)
    ups = np.array([way.up for way in ways])
    apart = np.degrees(np.arccos(np.clip(ups @ ups.T, -1, 1))) + 10 * np.eye(len(ups))
    assert apart.min() > 1.99


def test_tilts_surround_an_up():
    around = tilts(SLOPE)
    assert len(around) == TILTS
    assert all(abs(off_deg(up, SLOPE) - TILT_DEG) < 1e-6 for up in around)
    assert np.allclose(np.mean(around, axis=0) / np.cos(np.radians(TILT_DEG)), SLOPE)


def test_a_gravity_leaves_one_up(prepared):
    ways = level_hypotheses(prepared, None, usual_height_m=0.6, tilted=True)
    assert len(ways) == 1
    assert off_deg(ways[0].up, prepared.scans[0].up) < 1e-3
    assert ways[0].height_m == 0.6


def test_a_long_sequence_costs_no_more_than_its_last_scans():
    scans = [Scan.from_points(slope_with_posts(seed)) for seed in range(12)]
    poses = [make_transform(np.eye(3), [0.1 * k, 0, 0]) for k in range(12)]
    query = preprocess(ScanSequence.along(scans, poses), None, PreprocessConfig())
    ways = level_hypotheses(query, Z, usual_height_m=0.6, tilted=True)
    assert len(ways) <= 18
    assert np.allclose(ways[0].T_last_scan, np.eye(4)), "the last scan"
