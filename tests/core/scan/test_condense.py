"""Condensed scans: the robot computes the same parts as the server."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from firstfix.descriptor import LayeredOccupancy, PolarGrid
from firstfix.engine.config import EngineConfig, PcaScConfig, PreprocessConfig
from firstfix.engine.preprocess import preprocess
from firstfix.errors import InvalidOption, UnsupportedFormat
from firstfix.scan.condense import POINTS, condense, describe
from firstfix.scan.descriptor_parameters import DescriptorParameters
from firstfix.scan.reduction import RangeView, at_most, nearest_by_direction
from firstfix.scan.scan import Scan
from firstfix.scan.sequence import ScanSequence
from firstfix.transform import rotation_between

ENGINE = EngineConfig(preprocess=PreprocessConfig(min_range_m=0.3, voxel_m=0.25, default_height_m=0.7))
PARAMETERS = DescriptorParameters.from_engine(ENGINE.model_dump(mode="json"))
TILT = rotation_between([0.1, -0.06, 1.0], [0.0, 0.0, 1.0])


def room_scan(height_m: float = 1.2, n: int = 30_000) -> Scan:
    """A room of 12 x 8 x 3 m with a pillar, seen from a tilted sensor."""
    rng = np.random.default_rng(5)
    rays = rng.normal(size=(n, 3))
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    low, high = np.array([-7.0, -3.0, -height_m]), np.array([5.0, 5.0, 3.0 - height_m])
    ranges = np.where(rays > 0, high / rays, low / rays).min(axis=1)
    pillar = (rays[:, 0] > 0.85) & (np.abs(rays[:, 1]) < 0.15)
    ranges[pillar] = np.minimum(ranges[pillar], 2.0)
    points = rays * (ranges + rng.normal(0, 0.01, n))[:, None]
    return Scan.from_points(points @ TILT)


def test_the_descriptor_is_the_servers():
    scan, descriptor = room_scan(), ENGINE.descriptor.make()
    prepared = preprocess(ScanSequence.single(scan), None, ENGINE.preprocess)
    sent = describe(scan, PARAMETERS)
    assert np.degrees(np.arccos(sent.up @ TILT[2])) < 0.5
    assert sent.height_m == pytest.approx(1.2, abs=0.03)
    assert sent.agrees_with(descriptor)
    assert descriptor.similarity(sent.rows, prepared.scans[0].described_by(descriptor)) > 0.95


def test_gravity_levels_the_descriptor():
    sent = describe(room_scan(), PARAMETERS, gravity=np.array([0.0, 0.0, -9.81]))
    np.testing.assert_array_equal(sent.up, [0, 0, 1])


def test_where_no_floor_is_seen_the_height_is_the_maps():
    above = room_scan()
    walls = Scan(above.points[above.points @ TILT[2] > 0])
    assert describe(walls, PARAMETERS).height_m == 0.7


def test_points_are_an_even_part_of_the_voxel_means():
    many, few = (
        condense(room_scan(), PARAMETERS, points=10_000),
        condense(room_scan(), PARAMETERS, points=500),
    )
    assert len(few) == 500 < len(many)
    assert {tuple(p) for p in few.points} <= {tuple(p) for p in many.points}
    assert np.median(few.points, axis=0) == pytest.approx(np.median(many.points, axis=0), abs=0.5)
    assert len(condense(room_scan())) <= POINTS


def test_the_view_is_that_of_the_scan():
    scan = room_scan()
    compact = condense(scan)
    np.testing.assert_array_equal(compact.nearest_m, nearest_by_direction(at_most(scan.points, 20_000)))
    assert compact.described is None
    seen = preprocess(ScanSequence.single(compact), None, ENGINE.preprocess).scans[0].view
    np.testing.assert_array_equal(seen.least, RangeView.of_nearest(compact.nearest_m).least)


def test_the_server_levels_and_describes_a_compact_scan_alike():
    descriptor = ENGINE.descriptor.make()
    whole, compact = (
        preprocess(ScanSequence.single(scan), None, ENGINE.preprocess).scans[0]
        for scan in (room_scan(), condense(room_scan()))
    )
    assert np.degrees(np.arccos(whole.R_level_sensor[2] @ compact.R_level_sensor[2])) < 0.3
    assert compact.height_m == pytest.approx(whole.height_m, abs=0.03)
    alike = descriptor.similarity(whole.described_by(descriptor), compact.described_by(descriptor))
    assert alike > 0.9


def test_a_robots_descriptor_is_used_if_it_is_the_maps():
    compact = condense(room_scan(), PARAMETERS)
    prepared = preprocess(ScanSequence.single(compact), None, ENGINE.preprocess).scans[0]
    used = prepared.described_by(ENGINE.descriptor.make())
    assert np.shares_memory(used["occupancy"], compact.described.occupancy)
    other = LayeredOccupancy(PolarGrid(20, 60, 31.0))
    described = prepared.described_by(other)
    np.testing.assert_array_equal(described["occupancy"], other.describe(prepared.batch)["occupancy"])


@pytest.mark.parametrize("points", [np.zeros((0, 3)), np.full((5, 3), 500.0), np.full((5, 3), 0.01)])
def test_a_scan_out_of_range_is_an_empty_query(points):
    scan = Scan.from_points(points)
    assert len(condense(scan, PARAMETERS)) == 0
    assert not describe(scan, PARAMETERS).occupancy.any()
    assert preprocess(ScanSequence.single(condense(scan)), None, ENGINE.preprocess) is None


def test_invalid_parameters_are_refused():
    with pytest.raises(InvalidOption):
        condense(room_scan(), points=0)
    with pytest.raises(InvalidOption, match="parameters"):
        describe(room_scan(), DescriptorParameters())


@pytest.mark.parametrize(
    "engine", [{}, {"descriptor": {"kind": "occupancy"}}, EngineConfig(descriptor=PcaScConfig()).model_dump()]
)
def test_parameters_come_from_an_engine_that_robots_know(engine):
    with pytest.raises(UnsupportedFormat):
        DescriptorParameters.from_engine(engine)


def test_the_robot_needs_numpy_and_zstandard_alone():
    code = (
        "import sys, firstfix.scan.condense, firstfix.wire.query, firstfix.scan.descriptor_parameters;"
        "print(sorted({'scipy', 'faiss', 'pydantic', 'httpx'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
