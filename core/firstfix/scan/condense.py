"""Condensing a scan on the robot to the few kilobytes that a query needs. It needs NumPy only.

The server's preprocessing of a whole scan (``engine.preprocess``) makes the same parts: voxel means, nearest
returns by direction, a levelled descriptor. An even part of the voxel means has on average the same alignment
quality as all of them, so probabilities stay comparable. Larger voxels would not (lab/docs/experiments.md).
"""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..bit_exact.accelerated import accelerated
from ..bit_exact.eigh3 import smallest_eigenvectors
from ..descriptor import LayeredOccupancy, PolarGrid, ScanBatch
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

_Numbers: TypeAlias = "tuple[int, int, float, NDArray[np.float32]]"
_Described: TypeAlias = "tuple[NDArray[np.uint8], NDArray[np.float64], float]"


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
        InvalidOption: ``points`` or a parameter is out of range, or gravity has no direction.
    """
    if not 1 <= points <= MAX_COMPACT_POINTS:
        raise InvalidOption(f"a compact query has 1 to {MAX_COMPACT_POINTS} points, not {points}")
    used = parameters or DescriptorParameters()
    used.check()
    descriptor = used.descriptor
    means, nearest_m, time_s, described = condensed(
        scan.points,
        scan.time_s,
        used.min_range_m,
        used.max_range_m,
        used.voxel_m,
        used.default_height_m,
        None if descriptor is None else _numbers_of(descriptor),
        None if gravity is None else _checked(gravity),
        points,
    )
    if descriptor is None or described is None:
        return CompactScan(means, nearest_m, None, time_s)
    return CompactScan(means, nearest_m, ScanDescriptor(descriptor, *described), time_s)


@accelerated
def condensed(
    points: NDArray[np.float32],
    time_s: NDArray[np.float32] | None,
    min_range_m: float,
    max_range_m: float,
    voxel_m: float,
    default_height_m: float,
    descriptor: _Numbers | None,
    gravity: NDArray[np.float64] | None,
    most: int,
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32] | None, _Described | None]:
    """The parts of a compact scan: voxel means, nearest ranges by direction, mean times, description.

    Args:
        points: (n, 3) usable points.
        time_s: (n,) their times, or None.
        descriptor: rings, sectors, radius in metres and (layers + 1,) edges of the layers; None: the scan
            is not described.
        most: number of voxel means, at most.

    Returns:
        (m, 3) means; (cells,) ranges; (m,) times, or None; occupancy, (3,) up and height in metres, or None.
    """
    timed = TimedPoints(points, time_s).within_range(min_range_m, max_range_m)
    means, near = timed.at_most(_VOXELLED).voxel_means(voxel_m), timed.points
    described = None
    if descriptor is not None:
        exact = np.asarray(means.points, np.float64)
        described = _describe(near, exact, voxel_m, default_height_m, _descriptor_of(descriptor), gravity)
    chosen = means.by_voxel_hash(voxel_m, most)
    nearest_m = nearest_by_direction(at_most(near, _RETURNS))
    return chosen.points, nearest_m, chosen.time_s, described


def describe(
    scan: Scan, parameters: DescriptorParameters, gravity: NDArray[np.float64] | None = None
) -> ScanDescriptor:
    """The descriptor of a scan alone, for candidates without registration.

    Raises:
        InvalidOption: the parameters have no descriptor, one is out of range, or gravity has no direction.
    """
    if parameters.descriptor is None:
        raise InvalidOption("a descriptor needs the map's parameters: see DescriptorParameters.from_engine")
    parameters.check()
    near = within_range(scan.points, parameters.min_range_m, parameters.max_range_m)
    means = voxel_means(at_most(near, _VOXELLED), parameters.voxel_m, BORDER_M)
    descriptor, height_m = parameters.descriptor, parameters.default_height_m
    against = None if gravity is None else _checked(gravity)
    return ScanDescriptor(
        descriptor, *_describe(near, means, parameters.voxel_m, height_m, descriptor, against)
    )


def _describe(
    near: NDArray[np.float32],
    means: NDArray[np.float64],
    voxel_m: float,
    default_height_m: float,
    descriptor: LayeredOccupancy,
    gravity: NDArray[np.float64] | None,
) -> _Described:
    patches, normals = flat_patches(means, _PATCH_VOXELS * voxel_m)
    up = estimate_up(normals) if gravity is None else -gravity / _length(gravity)
    up = up.astype(np.float32).astype(np.float64)  # as it is sent: no result depends on further digits
    R_level_sensor = levelling_rotation(up)
    height_m = floor_height(turned(patches, R_level_sensor), turned(normals, R_level_sensor))
    if height_m is None:
        height_m = default_height_m
    levelled = ScanBatch.single(turned(near, R_level_sensor), height_m)
    return descriptor.describe(levelled)["occupancy"][0], up, height_m


def _numbers_of(descriptor: LayeredOccupancy) -> _Numbers:
    grid = descriptor.grid
    return grid.rings, grid.sectors, grid.max_range_m, np.asarray(descriptor.edges_m, np.float32)


def _descriptor_of(numbers: _Numbers) -> LayeredOccupancy:
    rings, sectors, max_range_m, edges_m = numbers
    return LayeredOccupancy(PolarGrid(rings, sectors, max_range_m), tuple(edges_m.tolist()))


def _checked(gravity: NDArray[np.float64]) -> NDArray[np.float64]:
    direction = np.asarray(gravity, np.float64)
    if direction.shape != (3,) or not 1e-6 <= _length(direction) <= 1e9:
        raise InvalidOption("gravity has no direction")
    return direction


def _length(vector: NDArray[np.float64]) -> float:
    x, y, z = (float(v) for v in vector)
    return math.sqrt(x * x + y * y + z * z)


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
