"""Preprocessing: scans are cropped, levelled and thinned, ready to be described and registered."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..descriptor import Described, Descriptor, LayeredOccupancy, ScanBatch
from ..native import turned_occupied_cells
from ..scan.compact import CompactScan, ScanDescriptor
from ..scan.levelling import estimate_up_near, floor_height, levelling_rotation, turned
from ..scan.range_view import RangeView, directions
from ..scan.scan import Scan
from ..scan.sequence import ScanSequence
from ..scan.up_hypotheses import other_ups
from ..scan.voxel_filter import BORDER_M, at_most, rows_by_voxel_hash, voxel_means, within_range
from ..transform import Matrix
from .config import PreprocessConfig
from .registration.surface import Surface

_SPARSE_POINTS = 400
_DENSE_POINTS = 4000
_RETURNS = 20_000
_APART_M = 0.9  # scans of one spot show the same surfaces again
_VOXELLED = 40_000  # points before one a voxel is kept: more points reach hardly any further voxel


@dataclass(frozen=True)
class PreparedScan:
    """One scan with its levelled frame: origin at the sensor, z up, x as near the sensor's x as possible.

    Attributes:
        T_last_scan: (4, 4) its pose in the frame of the query's last scan.
        R_level_sensor: (3, 3) levelling rotation.
        height_m: height of the sensor above the floor.
        seen: (p, 3) float32 all points within range, for the descriptor.
        described: the robot's own descriptor, or None. The robot had all points, ``seen`` may be coarser.
        view: ranges by direction, for the free-space check.
        thinned: points in the sensor frame, one a voxel.
    """

    T_last_scan: Matrix
    R_level_sensor: NDArray[np.float64]
    height_m: float
    seen: NDArray[np.float32]
    described: ScanDescriptor | None
    view: RangeView
    thinned: Surface

    @cached_property
    def batch(self) -> ScanBatch:
        """All points within range, levelled."""
        return ScanBatch.single(turned(self.seen, self.R_level_sensor), self.height_m)

    def described_by(self, descriptor: Descriptor) -> Described:
        """Returns the robot's own description if the descriptors agree: it had all points."""
        if self.described is not None and self.described.agrees_with(descriptor):
            return self.described.rows
        if isinstance(descriptor, LayeredOccupancy):  # without a copy of all points
            grid, edges_m = descriptor.grid, np.asarray(descriptor.edges_m, np.float32)
            form = grid.rings, grid.sectors, grid.max_range_m, edges_m
            return {"occupancy": turned_occupied_cells(self.seen, self.R_level_sensor, self.height_m, *form)}
        return descriptor.describe(self.batch)

    @property
    def up(self) -> NDArray[np.float64]:
        """(3,) unit vector against gravity in the sensor frame."""
        return self.R_level_sensor[2]

    def with_up(self, up: NDArray[np.float64], default_height_m: float) -> PreparedScan:
        """Returns the scan levelled by another up direction, (3,) in the sensor frame."""
        height_m = _height_by(up, self.thinned, default_height_m)
        return replace(self, R_level_sensor=levelling_rotation(up), height_m=height_m, described=None)


@dataclass(frozen=True)
class PreparedQuery:
    """Scans of a query, and their points together in the frame of the last scan.

    Attributes:
        dense: thinned points, for fine alignment.
        sparse: a part of them, enough to align and compare many candidates.
    """

    scans: tuple[PreparedScan, ...]
    dense: Surface
    sparse: Surface

    @cached_property
    def spots(self) -> int:
        """Number of spots, a metre apart, where scans of the query were taken."""
        chosen: list[NDArray[np.float64]] = []
        for scan in self.scans:
            spot = scan.T_last_scan[:3, 3]
            if all(float(np.linalg.norm(spot - other)) >= _APART_M for other in chosen):
                chosen.append(spot)
        return len(chosen)

    def with_other_ups(
        self, gravity: NDArray[np.float64] | None, config: PreprocessConfig
    ) -> tuple[PreparedScan, ...]:
        """Every scan, levelled by each of the other directions that may be up in the last scan."""
        last = self.scans[-1]
        known = last.T_last_scan[:3, :3] @ last.up
        ups = other_ups(self.dense.normals, known, gravity)
        return tuple(
            scan.with_up(scan.T_last_scan[:3, :3].T @ up, config.default_height_m)
            for up in ups
            for scan in self.scans
        )


def preprocess(
    sequence: ScanSequence,
    gravity: NDArray[np.float64] | None,
    config: PreprocessConfig,
    R_base_sensor: NDArray[np.float64] | None = None,
) -> PreparedQuery | None:
    """Prepares a query. Returns None if too few points are left.

    Args:
        gravity: (3,) direction of gravity in the last scan's sensor frame; None: estimated from the
            surfaces, for every scan. A scan that the robot has levelled stays as it is.
        R_base_sensor: (3, 3) mounting on a robot that stands nearly upright: up is estimated near the robot's
            z. None: near the sensor's z.
    """
    scans = []
    for scan, T_last_scan in zip(sequence.scans, sequence.T_last_scan, strict=True):
        down = None if gravity is None else T_last_scan[:3, :3].T @ gravity
        prepared = _prepare(scan, T_last_scan, down, config, R_base_sensor)
        if prepared is not None:
            scans.append(prepared)
    if not scans:
        return None
    together = Surface.together([scan.thinned.moved(scan.T_last_scan) for scan in scans])
    dense, sparse = (together.at_most(count, config.voxel_m) for count in (_DENSE_POINTS, _SPARSE_POINTS))
    return PreparedQuery(tuple(scans), dense, sparse)


@dataclass(frozen=True)
class _Returns:
    """Returns of one scan within range, from any encoding, in the sensor frame.

    Attributes:
        seen: (p, 3) float32, all points, for the descriptor.
        voxels: (v, 3) float32, some thousand points, one a voxel.
        view: ranges by direction.
    """

    seen: NDArray[np.float32]
    voxels: NDArray[np.float32]
    view: RangeView

    @classmethod
    def of(cls, scan: Scan | CompactScan, config: PreprocessConfig) -> _Returns:
        points = within_range(scan.points, config.min_range_m, config.max_range_m)
        if isinstance(scan, CompactScan):
            return cls._of_compact(points, scan.nearest_m, config)
        means = voxel_means(at_most(points, _VOXELLED), config.voxel_m, BORDER_M)
        means = means[rows_by_voxel_hash(means, config.voxel_m, _DENSE_POINTS)]
        return cls(points, means.astype(np.float32), RangeView.of(at_most(points, _RETURNS)))

    @classmethod
    def _of_compact(
        cls, points: NDArray[np.float32], nearest_m: NDArray[np.float32], config: PreprocessConfig
    ) -> _Returns:
        near = (nearest_m > config.min_range_m) & (nearest_m < config.max_range_m)
        nearest_m = np.where(near, nearest_m, np.float32(np.inf))
        # the nearest return of every direction fills cells of the descriptor that the voxels leave empty
        seen = np.concatenate([points, directions()[near] * nearest_m[near, None]])
        voxels = points[rows_by_voxel_hash(points, config.voxel_m, _DENSE_POINTS)]
        return cls(seen, voxels, RangeView.of_nearest(nearest_m))


def _prepare(
    scan: Scan | CompactScan,
    T_last_scan: Matrix,
    down: NDArray[np.float64] | None,
    config: PreprocessConfig,
    R_base_sensor: NDArray[np.float64] | None,
) -> PreparedScan | None:
    returns = _Returns.of(scan, config)
    if len(returns.voxels) < config.min_points:
        return None
    thinned = Surface.around(returns.voxels, -returns.voxels)
    described = scan.described if isinstance(scan, CompactScan) else None
    if described is not None:
        up, height_m = described.up, described.height_m
    else:
        expected = np.array([0.0, 0.0, 1.0]) if R_base_sensor is None else R_base_sensor[2]
        up = estimate_up_near(thinned.normals, expected) if down is None else -down
        height_m = _height_by(up, thinned, config.default_height_m)
    R_level_sensor = levelling_rotation(up)
    return PreparedScan(T_last_scan, R_level_sensor, height_m, returns.seen, described, returns.view, thinned)


def _height_by(up: NDArray[np.float64], surface: Surface, default_height_m: float) -> float:
    """Height of the sensor above the floor, for an up direction."""
    R = levelling_rotation(up)
    seen_m = floor_height(turned(surface.points, R), turned(surface.normals, R))
    return default_height_m if seen_m is None else seen_m
