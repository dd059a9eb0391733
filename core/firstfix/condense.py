"""On the robot: from a scan to the few kilobytes that a query needs. NumPy alone.

The server's own preprocessing of a whole scan (``preprocess``) makes the same things of it: voxel means,
nearest returns by direction, a levelled descriptor. An even part of the voxel means gives the same
measures of fit in the mean as all of them, so probabilities stay comparable; larger voxels would not
(benchmarks/BENCHMARK.md, encodings).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .compact_scan import MAX_COMPACT_POINTS, CompactScan, ScanDescriptor
from .descriptor import LayeredOccupancy, ScanBatch
from .errors import InvalidOption
from .levelling import estimate_up, floor_height
from .query_parameters import QueryParameters
from .scan import Scan
from .scan_view import nearest_by_direction
from .transform import rotation_between
from .voxel_filter import even_rows, voxel_means

POINTS = 2500
_RETURNS = 20_000  # looked at by direction
_VOXELLED = 40_000  # points whose voxels are averaged: more find hardly another voxel
_PATCH_VOXELS = 3.0  # a surface's normal is that of the voxel means in a cube of so many
_PATCH_POINTS = 4
_FLAT = 100.0  # variance along a patch over that across it: what is less flat has no one normal


def condense(
    scan: Scan,
    parameters: QueryParameters | None = None,
    gravity: NDArray[np.float64] | None = None,
    *,
    points: int = POINTS,
) -> CompactScan:
    """What a compact query holds of a scan.

    Args:
        parameters: of the map that will be asked; None: any map, and the server describes the scan.
        gravity: (3,) direction of gravity in the sensor frame; None: estimated, for the descriptor.
        points: at most, of the voxel means.

    Raises:
        InvalidOption: ``points`` is out of range.
    """
    if not 1 <= points <= MAX_COMPACT_POINTS:
        raise InvalidOption(f"a compact query has 1 to {MAX_COMPACT_POINTS} points, not {points}")
    used = parameters or QueryParameters()
    near = _within_range(scan, used)
    means = voxel_means(_at_most(near, _VOXELLED), used.voxel_m)
    described = None if used.descriptor is None else _describe(near, means, used, used.descriptor, gravity)
    chosen = means[even_rows(len(means), points)].astype(np.float32)
    return CompactScan(chosen, nearest_by_direction(_at_most(near, _RETURNS)), described)


def describe(
    scan: Scan, parameters: QueryParameters, gravity: NDArray[np.float64] | None = None
) -> ScanDescriptor:
    """The descriptor alone, for candidates without registration.

    Raises:
        InvalidOption: the parameters have no descriptor.
    """
    if parameters.descriptor is None:
        raise InvalidOption("a descriptor needs the map's parameters: QueryParameters.from_engine")
    near = _within_range(scan, parameters)
    means = voxel_means(_at_most(near, _VOXELLED), parameters.voxel_m)
    return _describe(near, means, parameters, parameters.descriptor, gravity)


def _within_range(scan: Scan, parameters: QueryParameters) -> NDArray[np.float32]:
    range2 = np.einsum("ij,ij->i", scan.points, scan.points)
    return scan.points[(range2 > parameters.min_range_m**2) & (range2 < parameters.max_range_m**2)]


def _describe(
    near: NDArray[np.float32],
    means: NDArray[np.float64],
    parameters: QueryParameters,
    descriptor: LayeredOccupancy,
    gravity: NDArray[np.float64] | None,
) -> ScanDescriptor:
    patches, normals = _patches(means, _PATCH_VOXELS * parameters.voxel_m)
    up = estimate_up(normals) if gravity is None else -gravity / np.linalg.norm(gravity)
    R_level_sensor = rotation_between(up, [0.0, 0.0, 1.0])
    height_m = floor_height(patches @ R_level_sensor.T, normals @ R_level_sensor.T)
    if height_m is None:
        height_m = parameters.default_height_m
    levelled = near @ R_level_sensor.T.astype(np.float32)
    occupancy = descriptor.describe(ScanBatch.single(levelled, height_m))["occupancy"][0]
    return ScanDescriptor(descriptor, occupancy, up, height_m)


def _patches(means: NDArray[np.float64], side_m: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Points of flat surfaces and the unit normals there, (n, 3) each."""
    if not len(means):
        return means, means
    patch = np.floor(means / side_m).astype(np.int64)
    patch -= patch.min(axis=0)
    size = patch.max(axis=0) + 1
    _, number, count = np.unique(
        (patch[:, 2] * size[1] + patch[:, 1]) * size[0] + patch[:, 0],
        return_inverse=True,
        return_counts=True,
    )

    def sums(values: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.bincount(number, values, len(count)).astype(np.float64)

    centre = np.stack([sums(means[:, axis]) for axis in range(3)], axis=1) / count[:, None]
    off = means - centre[number]
    scatter = np.empty((len(count), 3, 3))
    for a in range(3):
        for b in range(a, 3):
            scatter[:, a, b] = scatter[:, b, a] = sums(off[:, a] * off[:, b])
    variance, axes = np.linalg.eigh(scatter)
    flat = (count >= _PATCH_POINTS) & (variance[:, 1] > _FLAT * variance[:, 0])
    known = flat[number]
    return means[known], axes[number[known], :, 0]


def _at_most(points: NDArray[np.float32], count: int) -> NDArray[np.float32]:
    return points[:: max(1, -(-len(points) // count))]
