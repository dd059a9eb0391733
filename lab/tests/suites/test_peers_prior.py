"""Knowledge that peers are given beside a scan, and their use of it."""

from __future__ import annotations

import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from firstfix.engine.index import MapIndex
from firstfix.scan.scan import Scan
from firstfix.transform import Matrix, from_quaternion, inverse, make_transform, pose_error, transform_points
from firstfix_lab.suites.peers.kiss import CROPPED_VOXEL_M, Kiss, KissCropped
from firstfix_lab.suites.peers.peer_input import MAPPING_STEP_M, PeerInput
from firstfix_lab.suites.peers.prior import POSITION_OFF_M, Prior, coarse_positions
from firstfix_lab.suites.peers.scan_context import ScanContextPeer
from tests.recorded_data import Dataset, PoseTable

DOWN = np.array([0.0, 0.0, -1.0])
POSES = [from_quaternion([x_m, 0, 1], [0.12, 0.08, 0.3, 0.9]) for x_m in (-6.0, -5.0, 0.0, 6.0)]


def given(folder: Path, points: np.ndarray) -> PeerInput:
    """Of a place without scans of the mapping run."""
    rows = ["number,tx,ty,tz,qx,qy,qz,qw"]
    rows += [f"{k},{T[0, 3]},0,1,0.12,0.08,0.3,0.9" for k, T in enumerate(POSES)]
    (folder / "trajectory.csv").write_text("\n".join(rows) + "\n")
    tables = {"truth": PoseTable("eval.csv")}, PoseTable("trajectory.csv")
    np.save(folder / "map.npy", points)
    dataset = Dataset("place", ".", "", "{}", *tables, "vlp-16", root=folder)
    return PeerInput(dataset, folder, folder, folder, 0.5, 2.0, 0.5, 0.1)


def towers(seed: int) -> np.ndarray:
    """A floor with towers of different heights."""
    rng = np.random.default_rng(seed)
    parts = [rng.uniform([-30, -20, 0], [30, 20, 0], (20_000, 3))]
    for x_m, y_m, top_m in rng.uniform([-30, -20, 1], [30, 20, 12], (60, 3)):
        parts.append(np.array([x_m, y_m, 0]) + rng.uniform([-1, -1, 0], [1, 1, top_m], (400, 3)))
    return np.concatenate(parts)


def test_a_coarse_position_is_anywhere_in_a_disc_and_the_same_in_each_run():
    off_m = np.linalg.norm(coarse_positions(4000, 1), axis=1)
    assert off_m.max() <= POSITION_OFF_M
    assert np.mean(off_m < POSITION_OFF_M / 2) == pytest.approx(0.25, abs=0.03)
    np.testing.assert_array_equal(coarse_positions(7, 1), coarse_positions(7, 1))
    assert np.abs(coarse_positions(4000, 1).mean(axis=0)).max() < 0.5


@pytest.mark.parametrize("make", [Kiss, KissCropped])
def test_kiss_matcher_gets_the_whole_map_or_what_the_scan_may_reach(make, tmp_path, monkeypatch):
    points = np.random.default_rng(3).uniform([-80, -80, 0], [80, 80, 3], (30_000, 3))
    true = make_transform(np.eye(3), [20.0, 10.0, 1.0])
    near = points[np.linalg.norm(points - true[:3, 3], axis=1) < 25]
    asked: dict[str, np.ndarray] = {}

    class StandIn:
        def __init__(self, voxel_m: float) -> None:
            asked["voxel_m"] = np.array(voxel_m)

        def estimate(self, scan: np.ndarray, searched: np.ndarray) -> Any:
            asked["map"] = searched
            return SimpleNamespace(rotation=np.eye(3), translation=true[:3, 3])

        def get_num_final_inliers(self) -> int:
            return 5

    stand_in = SimpleNamespace(KISSMatcher=StandIn, KISSMatcherConfig=float)
    monkeypatch.setitem(sys.modules, "kiss_matcher", stand_in)
    peer = make(given(tmp_path, points))
    found = peer(Scan.from_points(near - true[:3, 3]), Prior(DOWN, true[:2, 3] + [0.0, POSITION_OFF_M]))
    assert (found.confidence, found.is_accepted) == (5.0, True)
    if make is Kiss:
        assert len(asked["map"]) == len(points)
        assert asked["voxel_m"] == 2.0
        return
    assert asked["voxel_m"] == CROPPED_VOXEL_M
    away_m = np.linalg.norm(points - true[:3, 3], axis=1)
    reached = points[away_m < np.percentile(away_m[away_m < 25], 90)]
    assert set(map(tuple, reached.astype(np.float32))) <= set(map(tuple, asked["map"]))
    assert len(asked["map"]) < len(points) / 4


def test_without_scans_of_the_mapping_run_the_map_round_its_poses_stands_for_them(tmp_path):
    points = towers(4)
    clouds = list(given(tmp_path, points).mapping_clouds(9.0))
    assert len(clouds) == 3
    for (cloud, T_map_sensor), true in zip(clouds, (POSES[0], *POSES[2:]), strict=True):
        np.testing.assert_allclose(T_map_sensor, true, atol=1e-6)
        assert np.linalg.norm(cloud, axis=1).max() < 9.0
        assert len(cloud) == np.sum(np.linalg.norm(points - true[:3, 3], axis=1) < 9.0)
    assert np.linalg.norm(POSES[1][:3, 3] - POSES[0][:3, 3]) < MAPPING_STEP_M


def test_scan_context_levels_tilted_scans(tmp_path, monkeypatch):
    class Retrieval(ScanContextPeer):
        def _register(self, scan: Scan, T_map_sensor: Matrix) -> Matrix:
            return T_map_sensor

    monkeypatch.setattr(MapIndex, "load", lambda folder: None)
    points = towers(5)
    peer = Retrieval(given(tmp_path, points))
    for at in (POSES[0], POSES[2], POSES[3]):
        true = make_transform(from_quaternion(np.zeros(3), [-0.2, 0.1, 0.7, 0.6])[:3, :3], at[:3, 3])
        near = points[np.linalg.norm(points - true[:3, 3], axis=1) < 60]
        scan = Scan.from_points(transform_points(inverse(true), near))
        found = peer(scan, Prior(true[:3, :3].T @ DOWN, true[:2, 3]))
        assert found.T_map_sensor is not None
        off_m, off_deg = pose_error(true, found.T_map_sensor)
        assert off_m < 1e-6
        assert off_deg < 3.1  # half a sector
        assert found.is_accepted
