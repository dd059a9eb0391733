"""hdl_global_localization's engine FPFH_RANSAC by its published method (koide3, BSD-2), then ICP.

Parameters of its ``config``: ``general_config.yaml`` (clouds thinned to 0.5 m), ``fpfh_config.yaml`` (radii)
and ``ransac_config.yaml`` (the rest). FPFH is Open3D's. Normals are turned to the sensor, in the map to the
nearest mapping pose. The engine turns those of the map to its origin, which agrees with fewer scans. Its
confidence is the share of the scan's points that lie near points of the map. Poses with up to 0.25 are no
results of the engine (``inlier_fraction``), so they are not accepted.
"""

from __future__ import annotations

import faiss
import numpy as np
import open3d as o3d
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from firstfix.scan.reduction import voxel_means
from firstfix.scan.scan import Scan
from firstfix.transform import Matrix, make_transform

from .answer import Answer
from .icp import Icp
from .near_map import NearMap
from .peer_input import PeerInput
from .prior import Prior
from .sent import points_bytes

VOXEL_M, NORMAL_RADIUS_M, FEATURE_RADIUS_M = 0.5, 2.0, 4.0
ITERATIONS, MAX_HYPOTHESES, SIMILAR_FEATURES = 1_000_000, 10_000, 2
EDGES_ALIKE, NEAR_M, MIN_SHARE = 0.5, 1.0, 0.25
BATCH = 20_000  # iterations
ICP_REACH_M = 1.5


class HdlFpfh:
    sent_bytes = staticmethod(points_bytes)

    def __init__(self, given: PeerInput) -> None:
        points = given.map_points()
        self._given = given
        self._points = voxel_means(points, VOXEL_M).astype(np.float64)
        mapping = np.array([T[:3, 3] for T in given.mapping_poses()])
        seen_from = mapping[cKDTree(mapping).query(self._points)[1]]
        self._index = faiss.IndexFlatL2(33)
        self._index.add(fpfh_of(self._points, seen_from))
        self._near = NearMap(self._points, NEAR_M)
        self._icp = Icp(points, ICP_REACH_M)

    def __call__(self, scan: Scan, prior: Prior) -> Answer:
        whole = self._given.cropped(scan)
        points = voxel_means(whole, VOXEL_M).astype(np.float64)
        if len(points) < 3:
            return Answer()
        similar = self._index.search(fpfh_of(points, np.zeros((1, 3))), SIMILAR_FEATURES)[1]
        share, T_map_sensor = best_pose(points, self._points[similar], self._near)
        if T_map_sensor is None:
            return Answer()
        return Answer(self._icp.refine(whole, T_map_sensor), share, share > MIN_SHARE)


def fpfh_of(points: NDArray[np.float64], seen_from: NDArray[np.float64]) -> NDArray[np.float32]:
    """(n, 33) features of (n, 3) points.

    Args:
        seen_from: (n, 3) or (1, 3) places to which the normals are turned.
    """
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
    cloud.estimate_normals(o3d.geometry.KDTreeSearchParamRadius(NORMAL_RADIUS_M))
    normals = np.asarray(cloud.normals)
    away = np.sum(normals * (seen_from - points), axis=1) < 0
    cloud.normals = o3d.utility.Vector3dVector(np.where(away[:, None], -normals, normals))
    around = o3d.geometry.KDTreeSearchParamRadius(FEATURE_RADIUS_M)
    features = o3d.pipelines.registration.compute_fpfh_feature(cloud, around).data
    return np.ascontiguousarray(features.T, np.float32)


def best_pose(
    points: NDArray[np.float64], similar: NDArray[np.float64], near: NearMap
) -> tuple[float, Matrix | None]:
    """The largest share of points near the map, over poses by three matches each, and T_map_sensor.

    Args:
        points: (n, 3) in the sensor frame.
        similar: (n, k, 3) points of the map with a feature like theirs.
    """
    rng = np.random.default_rng(0)
    best, best_pose, tried = 0.0, None, 0
    for _ in range(ITERATIONS // BATCH):
        rows = rng.integers(len(points), size=(BATCH, 3))
        theirs = similar[rows, rng.integers(similar.shape[1], size=rows.shape)]  # (batch, 3, 3)
        kept = _distinct(rows) & _edges_alike(points[rows], theirs)
        rotations, shifts = rigid_transforms(points[rows[kept]], theirs[kept])
        left = MAX_HYPOTHESES - tried
        shares = near.shares(points, rotations[:left], shifts[:left])
        if len(shares) and shares.max() > best:
            row = int(np.argmax(shares))
            best, best_pose = float(shares[row]), make_transform(rotations[row], shifts[row])
        tried += len(shares)
        if tried >= MAX_HYPOTHESES:
            break
    return best, best_pose


def rigid_transforms(
    a: NDArray[np.float64], b: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(k, 3, 3) rotations and (k, 3) shifts that bring (k, m, 3) points a to b with least squares."""
    mean_a, mean_b = a.mean(axis=1), b.mean(axis=1)
    covariance = np.swapaxes(b - mean_b[:, None], 1, 2) @ (a - mean_a[:, None])
    u, _, vt = np.linalg.svd(covariance)
    u[:, :, 2] *= np.sign(np.linalg.det(u @ vt))[:, None]  # no mirrors
    rotations = u @ vt
    return rotations, mean_b - (rotations @ mean_a[..., None])[..., 0]


def _distinct(rows: NDArray[np.int64]) -> NDArray[np.bool_]:
    """(k, 3) to (k,): whether all three differ."""
    return (rows != np.roll(rows, 1, axis=1)).all(axis=1)


def _edges_alike(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(k, 3, 3) corners of two triangles to (k,): whether no edge is much longer in one of them."""
    edges_a, edges_b = (np.linalg.norm(t - np.roll(t, 1, axis=1), axis=2) for t in (a, b))
    return (np.minimum(edges_a, edges_b) >= EDGES_ALIKE * np.maximum(edges_a, edges_b)).all(axis=1)
