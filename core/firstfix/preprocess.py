"""From a scan as it comes to points that can be described and registered: cropped, levelled, thinned."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from small_gicp import voxelgrid_sampling

from .descriptor import ScanBatch
from .engine_config import PreprocessConfig
from .levelling import estimate_up, floor_height
from .map_view import ScanView
from .scan import Scan
from .scan_sequence import ScanSequence
from .surface import Surface
from .transform import Matrix, rotation_between

_SPARSE_POINTS = 400
_DENSE_POINTS = 6000
_RETURNS = 20_000
_VOXELLED = 40_000  # points, of which one a voxel is kept: more find hardly another voxel


@dataclass(frozen=True)
class PreparedScan:
    """One scan, and its levelled frame: the sensor's origin, z up, x as near the sensor's as it goes.

    Attributes:
        T_last_scan: (4, 4) its pose in the frame of the query's last scan.
        R_level_sensor: (3, 3).
        batch: all points within range, levelled: for the descriptor.
        view: what the sensor saw: for free space.
        thinned: points in the sensor frame, one a voxel.
    """

    T_last_scan: Matrix
    R_level_sensor: NDArray[np.float64]
    batch: ScanBatch
    view: ScanView
    thinned: Surface

    @property
    def height_m(self) -> float:
        """Of the sensor above the floor."""
        return float(self.batch.height_m[0])


@dataclass(frozen=True)
class PreparedQuery:
    """The scans of a query, and all of them in the frame of the last.

    Attributes:
        dense: thinned points, for fine registration.
        sparse: a fraction of them: enough to settle and compare many candidates.
    """

    scans: tuple[PreparedScan, ...]
    dense: Surface
    sparse: Surface


def preprocess(
    sequence: ScanSequence, gravity: NDArray[np.float64] | None, config: PreprocessConfig
) -> PreparedQuery | None:
    """None where too few points are left to say anything.

    Args:
        gravity: (3,) direction of gravity in the last scan's sensor frame; None: estimated from the
            surfaces, for every scan.
    """
    scans = []
    for scan, T_last_scan in zip(sequence.scans, sequence.T_last_scan, strict=True):
        down = None if gravity is None else T_last_scan[:3, :3].T @ gravity
        prepared = _prepare(scan, T_last_scan, down, config)
        if prepared is not None:
            scans.append(prepared)
    if not scans:
        return None
    together = Surface.together([scan.thinned.moved(scan.T_last_scan) for scan in scans])
    return PreparedQuery(tuple(scans), together.at_most(_DENSE_POINTS), together.at_most(_SPARSE_POINTS))


def _prepare(
    scan: Scan, T_last_scan: Matrix, gravity: NDArray[np.float64] | None, config: PreprocessConfig
) -> PreparedScan | None:
    range2 = np.einsum("ij,ij->i", scan.points, scan.points)
    near, far = config.min_range_m**2, config.max_range_m**2
    points = scan.points[(range2 > near) & (range2 < far)]
    if len(points) < config.min_points:
        return None
    some = points[:: -(-len(points) // _VOXELLED)].astype(np.float64)
    voxels = voxelgrid_sampling(some, config.voxel_m).points()[:, :3]
    if len(voxels) < config.min_points:
        return None
    voxels = voxels[:: -(-len(voxels) // _DENSE_POINTS)]
    thinned = Surface.around(voxels, -voxels)
    normals = thinned.normals
    up = estimate_up(normals) if gravity is None else -gravity
    R_level_sensor = rotation_between(up, [0.0, 0.0, 1.0])
    levelled = thinned.points @ R_level_sensor.T
    height = floor_height(levelled, normals @ R_level_sensor.T)
    if height is None:
        height = config.default_height_m
    return PreparedScan(
        T_last_scan,
        R_level_sensor,
        ScanBatch.single(points @ R_level_sensor.T.astype(np.float32), height),
        ScanView.of(points[:: -(-len(points) // _RETURNS)]),
        thinned,
    )
