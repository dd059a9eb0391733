"""Condensing a scan on the robot to the few kilobytes that a query needs. It needs NumPy only.

The server's preprocessing of a whole scan (``engine.preprocess``) makes the same parts: voxel means, nearest
returns by direction, a levelled descriptor. An even part of the voxel means has on average the same alignment
quality as all of them, so probabilities stay comparable. Larger voxels would not (lab/docs/experiments.md).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..bit_exact.accelerated import accelerated
from ..bit_exact.eigh3 import smallest_eigenvectors
from ..descriptor import LayeredOccupancy, ScanBatch
from ..errors import InvalidOption
from .compact import MAX_COMPACT_POINTS, CompactScan, ScanDescriptor
from .descriptor_parameters import DescriptorParameters
from .levelling import estimate_up, floor_height, levelling_rotation, turned
from .reduction import BORDER_M, TimedPoints, at_most, nearest_by_direction, voxel_means, within_range
from .scan import Scan

POINTS = 2500
_RETURNS = 20_000  # points for the nearest ranges by direction
_VOXELLED = 40_000  # points whose voxels are averaged: more points reach hardly any further voxel
_PATCH_VOXELS = 3.0  # edge, in voxels, of the cubes in which a surface normal is computed
_PATCH_POINTS = 4  # voxel means in a cube, at least
_FLAT = 100.0  # variance along a patch over that across it, at least: less flat patches have no clear normal


def condense(
    scan: Scan,
    parameters: DescriptorParameters | None = None,
    gravity: NDArray[np.float64] | None = None,
    *,
    points: int = POINTS,
) -> CompactScan:
    """The compact form of a scan.

    Args:
        parameters: of the map that will be asked; None: for any map, and the server describes the scan.
        gravity: (3,) direction of gravity in the sensor frame, for the descriptor; None: it is estimated.
        points: largest number of voxel means to keep.

    Raises:
        InvalidOption: ``points`` is out of range.
    """
    if not 1 <= points <= MAX_COMPACT_POINTS:
        raise InvalidOption(f"a compact query has 1 to {MAX_COMPACT_POINTS} points, not {points}")
    used = parameters or DescriptorParameters()
    timed = TimedPoints(scan.points, scan.time_s).within_range(used.min_range_m, used.max_range_m)
    means, near = timed.at_most(_VOXELLED).voxel_means(used.voxel_m), timed.points
    described = None
    if used.descriptor is not None:
        exact = np.asarray(means.points, np.float64)
        described = _describe(near, exact, used, used.descriptor, gravity)
    chosen = means.by_voxel_hash(used.voxel_m, points)
    nearest_m = nearest_by_direction(at_most(near, _RETURNS))
    return CompactScan(chosen.points, nearest_m, described, chosen.time_s)


def describe(
    scan: Scan, parameters: DescriptorParameters, gravity: NDArray[np.float64] | None = None
) -> ScanDescriptor:
    """The descriptor of a scan alone, for candidates without registration.

    Raises:
        InvalidOption: the parameters have no descriptor.
    """
    if parameters.descriptor is None:
        raise InvalidOption("a descriptor needs the map's parameters: see DescriptorParameters.from_engine")
    near = within_range(scan.points, parameters.min_range_m, parameters.max_range_m)
    means = voxel_means(at_most(near, _VOXELLED), parameters.voxel_m, BORDER_M)
    return _describe(near, means, parameters, parameters.descriptor, gravity)


def _describe(
    near: NDArray[np.float32],
    means: NDArray[np.float64],
    parameters: DescriptorParameters,
    descriptor: LayeredOccupancy,
    gravity: NDArray[np.float64] | None,
) -> ScanDescriptor:
    patches, normals = flat_patches(means, _PATCH_VOXELS * parameters.voxel_m)
    up = estimate_up(normals) if gravity is None else _against(gravity)
    up = up.astype(np.float32).astype(np.float64)  # as it is sent: no result depends on further digits
    R_level_sensor = levelling_rotation(up)
    height_m = floor_height(turned(patches, R_level_sensor), turned(normals, R_level_sensor))
    if height_m is None:
        height_m = parameters.default_height_m
    levelled = ScanBatch.single(turned(near, R_level_sensor), height_m)
    occupancy = descriptor.describe(levelled)["occupancy"][0]
    return ScanDescriptor(descriptor, occupancy, up, height_m)


def _against(gravity: NDArray[np.float64]) -> NDArray[np.float64]:
    x, y, z = (float(v) for v in gravity)
    return -gravity / math.sqrt(x * x + y * y + z * z)


@accelerated
def flat_patches(
    means: NDArray[np.float64], side_m: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Point on flat surfaces, and their unit normals, (n, 3) each."""
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
    filled = np.flatnonzero(count >= _PATCH_POINTS)
    variance, axes = smallest_eigenvectors(scatter[filled])
    flat = variance[:, 1] > _FLAT * variance[:, 0]
    normal = np.zeros((len(count), 3))
    normal[filled[flat]] = axes[flat]
    known = np.isin(number, filled[flat])
    return means[known], normal[number[known]]
