"""Reference of ``engine.preprocess``: one scan, step by step with NumPy and the kernels of each step."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from firstfix.engine.changes.at_stamp import timed_view
from firstfix.engine.config import PreprocessConfig
from firstfix.engine.preprocess import PreparedScan
from firstfix.engine.ranking import AlignmentConfig
from firstfix.engine.registration.surface import Surface
from firstfix.scan.compact import CompactScan
from firstfix.scan.levelling import estimate_up, floor_height, levelling_rotation, turned
from firstfix.scan.reduction import RangeView, TimedPoints, directions
from firstfix.scan.scan import Scan

MIN_SWEEP_S = 0.005  # between the first and the last point


def prepared(
    scan: Scan | CompactScan,
    up: NDArray[np.float64],
    config: PreprocessConfig,
    ranking: AlignmentConfig,
    *,
    up_is_known: bool = False,
) -> PreparedScan | None:
    """The scan, prepared; None: too few points are left.

    Args:
        up: (3,) in the sensor frame: known, or expected.
    """
    time_s = scan.time_s
    if time_s is not None and (not len(time_s) or float(np.ptp(time_s)) < MIN_SWEEP_S):
        time_s = None
    near = TimedPoints(scan.points, time_s).within_range(config.min_range_m, config.max_range_m)
    described = None
    if isinstance(scan, CompactScan):
        described = scan.described
        in_range = (scan.nearest_m > config.min_range_m) & (scan.nearest_m < config.max_range_m)
        nearest_m = np.where(in_range, scan.nearest_m, np.float32(np.inf))
        cells = np.flatnonzero(in_range)
        returns = directions().take(cells, axis=0) * nearest_m.take(cells)[:, None]
        seen = np.concatenate([near.points, returns])
        view, voxelled = RangeView.of_nearest(nearest_m), near
        viewed = None if time_s is None else timed_view(near, nearest_m)
    else:
        seen, voxelled = near.points, near.at_most(ranking.voxelled_points).voxel_means(config.voxel_m)
        viewed = near.at_most(ranking.view_points)
        view = RangeView.of(viewed.points)
    voxels = voxelled.by_voxel_hash(config.voxel_m, ranking.dense_points)
    if len(voxels.points) < config.min_points:
        return None
    thinned = replace(Surface.around(voxels.points, -voxels.points), time_s=voxels.time_s)
    if described is not None:
        up, height_m = described.up, described.height_m
    else:
        up = up if up_is_known else _estimated(thinned.normals, up)
        R = levelling_rotation(up)
        seen_m = floor_height(turned(thinned.points, R), turned(thinned.normals, R))
        height_m = config.default_height_m if seen_m is None else seen_m
    R_level_sensor = levelling_rotation(up)
    return PreparedScan(np.eye(4), R_level_sensor, height_m, seen, described, view, thinned, viewed)


def _estimated(normals: NDArray[np.float32], expected: NDArray[np.float64]) -> NDArray[np.float64]:
    R = levelling_rotation(expected)
    up = estimate_up(np.ascontiguousarray(turned(normals, R)))
    return np.array([R[0, k] * up[0] + R[1, k] * up[1] + R[2, k] * up[2] for k in range(3)])
