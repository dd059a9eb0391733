"""RANSAC over matched features, as hdl_global_localization does it, on exact geometry."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from firstfix.scan.scan import Scan
from firstfix.transform import from_quaternion, inverse, make_transform, pose_error, transform_points
from firstfix_lab.suites.peers.hdl_fpfh import HdlFpfh, best_pose, rigid_transforms
from firstfix_lab.suites.peers.near_map import NearMap
from firstfix_lab.suites.peers.peer_input import PeerInput
from firstfix_lab.suites.peers.prior import Prior
from tests.recorded_data import Dataset, PoseTable

TRUE = from_quaternion([3.0, -2.0, 1.0], [0.1, -0.05, 0.6, 0.79])
ANYWHERE = Prior(np.array([0.0, 0.0, -1.0]), np.zeros(2))


def place(seed: int) -> np.ndarray:
    """A hall with boxes at random places, as points on its surfaces."""
    rng = np.random.default_rng(seed)
    parts = [surface(rng, [-12, -9, 0], [12, 9, 6], 30_000)]
    for _ in range(10):
        low = np.append(rng.uniform([-11, -8], [8, 5]), 0.0)
        parts.append(surface(rng, low, low + rng.uniform([0.8, 0.8, 0.8], [3.0, 3.0, 4.0]), 3000))
    return np.concatenate(parts)


def surface(rng: np.random.Generator, low: np.ndarray, high: np.ndarray, count: int) -> np.ndarray:
    """(count, 3) points on the faces of a box."""
    points = rng.uniform(low, high, (count, 3))
    rows, axes = np.arange(count), rng.integers(3, size=count)
    points[rows, axes] = np.where(rng.random(count) < 0.5, np.asarray(low)[axes], np.asarray(high)[axes])
    return points


def some_of(points: np.ndarray, one_in: int) -> np.ndarray:
    """One in so many points, by seeded chance."""
    return np.random.default_rng(9).choice(points, len(points) // one_in, replace=False)


def test_triangles_are_brought_onto_each_other():
    a = np.random.default_rng(1).normal(size=(50, 3, 3))
    b = np.stack([transform_points(TRUE, one) for one in a])
    rotations, shifts = rigid_transforms(a, b)
    np.testing.assert_allclose(rotations, np.broadcast_to(TRUE[:3, :3], rotations.shape), atol=1e-9)
    np.testing.assert_allclose(shifts, np.broadcast_to(TRUE[:3, 3], shifts.shape), atol=1e-9)


def test_what_is_near_lies_in_a_voxel_whose_centre_is_near_the_map():
    rng = np.random.default_rng(2)
    there, points = rng.uniform(0, 20, (300, 3)), rng.uniform(-5, 5, (400, 3))
    rotations, shifts = np.stack([TRUE[:3, :3], np.eye(3)]), np.array([[8.0, 9.0, 10.0], [0.0, 0.0, 0.0]])
    found = NearMap(there, 1.0).shares(points, rotations, shifts)
    for share, rotation, shift in zip(found, rotations, shifts, strict=True):
        moved = points @ rotation.T + shift
        low = there.min(axis=0) - 2
        centres = np.floor(moved - low) + 0.5 + low
        away_m = np.linalg.norm(centres[:, None] - there, axis=2).min(axis=1)
        assert share == pytest.approx(np.mean(away_m < 1.0), abs=0.005)  # float32 at a voxel's border
    assert found[0] > 0.1


def test_few_right_matches_are_enough_and_none_gives_no_pose():
    points = some_of(place(3), 40)
    scan = transform_points(inverse(TRUE), points)
    rng = np.random.default_rng(4)
    similar = points[rng.integers(len(points), size=(len(points), 2))]
    right = rng.random(len(points)) < 0.15
    similar[right, 0] = points[right]
    share, found = best_pose(scan, similar, NearMap(points, 1.0))
    assert found is not None
    off_m, off_deg = pose_error(TRUE, found)
    assert off_m < 0.3
    assert off_deg < 2
    assert share > 0.95
    nowhere = np.zeros_like(similar)  # all of a scan is like one point
    assert best_pose(scan, nowhere, NearMap(points, 1.0)) == (0.0, None)


def test_a_scan_is_found_by_its_features_and_a_strange_one_fits_less(tmp_path: Path):
    points = place(5)
    (tmp_path / "trajectory.csv").write_text("number,tx,ty,tz,qx,qy,qz,qw\n0,0,0,1,0,0,0,1\n")
    tables = {"truth": PoseTable("eval.csv")}, PoseTable("trajectory.csv")
    dataset = Dataset("place", ".", "", "{}", *tables, "vlp-16", root=tmp_path)
    np.save(tmp_path / "map.npy", points)
    peer = HdlFpfh(PeerInput(dataset, tmp_path, tmp_path, tmp_path, 0.5, 0.5, 0.5, 0.1))
    found = peer(Scan.from_points(transform_points(inverse(TRUE), some_of(points, 3))), ANYWHERE)
    assert found.T_map_sensor is not None
    off_m, off_deg = pose_error(TRUE, found.T_map_sensor)
    assert off_m < 0.05
    assert off_deg < 0.5
    assert found.is_accepted
    strange = peer(Scan.from_points(some_of(place(6), 3) * [3.0, 0.3, 2.0]), ANYWHERE)
    assert found.confidence is not None
    assert strange.confidence is not None
    assert strange.confidence < found.confidence - 0.2
    assert peer(Scan.from_points(np.full((9, 3), 0.01)), ANYWHERE).T_map_sensor is None  # the carrier alone


def test_no_transform_is_a_mirror():
    flat = np.array([[[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]])
    rotations, _ = rigid_transforms(flat, flat[:, ::-1])
    assert np.linalg.det(rotations[0]) == pytest.approx(1.0)
    np.testing.assert_allclose(make_transform(rotations[0], np.zeros(3))[3], [0, 0, 0, 1])
