"""Preprocessing: scans are cropped, levelled and thinned, ready to be described and registered."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..descriptor import Described, Descriptor, LayeredOccupancy, ScanBatch
from ..errors import InvalidOption
from ..native import deskew, turned_occupied_cells
from ..scan.compact import CompactScan, ScanDescriptor
from ..scan.levelling import estimate_up_near, floor_height, levelling_rotation, turned
from ..scan.reduction import COLUMNS, RangeView, TimedPoints, directions, nearest_by_direction
from ..scan.scan import Scan
from ..scan.sequence import ScanSequence
from ..scan.up_hypotheses import other_ups
from ..transform import Matrix
from .config import PreprocessConfig
from .ranking import RANKING, AlignmentConfig
from .registration.surface import Surface

MIN_SWEEP_S = 0.005  # between the first and the last point: in less, nothing moves far enough to be seen


def sweep_times(time_s: NDArray[np.float32] | None) -> NDArray[np.float32] | None:
    """The (n,) times of a scan's points, or None where they cannot show a motion: a flash, or all zeros."""
    if time_s is None or not len(time_s) or float(np.ptp(time_s)) < MIN_SWEEP_S:
        return None
    return time_s


def timed_view(timed: TimedPoints, nearest_m: NDArray[np.float32]) -> TimedPoints:
    """The returns of a range view, each in the middle of its direction.

    Its time is the mean of those of the points in its column. A spinning sensor sees a column at one time.
    The times of any other one are spread over its columns: their mean then changes little.

    Args:
        timed: points of the scan, with times.
        nearest_m: (cells,) nearest ranges by direction, infinite where nothing returned.
    """
    assert timed.time_s is not None
    azimuth = np.arctan2(timed.points[:, 1], timed.points[:, 0])
    of_point = ((azimuth / (2 * np.pi) + 0.5) * COLUMNS).astype(np.int64) % COLUMNS
    count = np.bincount(of_point, minlength=COLUMNS)
    mean_s = np.bincount(of_point, timed.time_s, COLUMNS) / np.maximum(count, 1)
    known = np.flatnonzero(count)
    column_s = np.interp(np.arange(COLUMNS), known, mean_s[known]) if len(known) else mean_s
    seen = np.flatnonzero(np.isfinite(nearest_m))
    return TimedPoints(_returns_at(nearest_m, seen), column_s[seen % COLUMNS].astype(np.float32))


def deskewed(sequence: ScanSequence, twist: NDArray[np.float64] | None) -> ScanSequence:
    """The sequence with its last scan as it would have been seen at its stamp. None changes nothing.

    The other scans stay as they are: the twist is that of the last one.

    Args:
        twist: (6,) m/s then rad/s, in the sensor frame.

    Raises:
        InvalidOption: the times of the points are not known.
    """
    if twist is None:
        return sequence
    last = sequence.scans[-1]
    if last.time_s is None:
        raise InvalidOption("a twist needs the times of the scan's points")
    motion = np.asarray(twist, np.float64)
    still: Scan | CompactScan = replace(last, points=deskew(last.points, last.time_s, motion), time_s=None)
    if isinstance(last, CompactScan) and isinstance(still, CompactScan):
        returns = timed_view(TimedPoints(last.points, last.time_s), last.nearest_m)
        assert returns.time_s is not None
        moved = deskew(returns.points, returns.time_s, motion)
        still = replace(still, nearest_m=nearest_by_direction(moved))
    return ScanSequence((*sequence.scans[:-1], still), sequence.T_last_scan)


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
        returns: the points of the view with their times, if it can be deskewed.
    """

    T_last_scan: Matrix
    R_level_sensor: NDArray[np.float64]
    height_m: float
    seen: NDArray[np.float32]
    described: ScanDescriptor | None
    view: RangeView
    thinned: Surface
    returns: TimedPoints | None = None

    def view_deskewed(self, twist: NDArray[np.float64] | None) -> RangeView:
        """Ranges by direction as they would have been seen at the stamp, for a (6,) twist during the scan."""
        if twist is None or self.returns is None or self.returns.time_s is None:
            return self.view
        return RangeView.of(deskew(self.returns.points, self.returns.time_s, twist))

    @cached_property
    def batch(self) -> ScanBatch:
        """All points within range, levelled."""
        return ScanBatch.single(turned(self.seen, self.R_level_sensor), self.height_m)

    def described_by(self, descriptor: Descriptor) -> Described:
        """The robot's own description if the descriptors agree: it had all points."""
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

    def with_up(
        self, up: NDArray[np.float64], default_height_m: float, height_m: float | None = None
    ) -> PreparedScan:
        """The scan levelled by another up direction, (3,) in the sensor frame.

        Args:
            height_m: of the sensor above the floor; None: as the scan shows it.
        """
        if height_m is None:
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


def spots_of(scans: Iterable[PreparedScan], apart_m: float) -> int:
    """Number of spots, ``apart_m`` apart, where the scans of a query were taken."""
    chosen: list[NDArray[np.float64]] = []
    for scan in scans:
        spot = scan.T_last_scan[:3, 3]
        if all(float(np.linalg.norm(spot - other)) >= apart_m for other in chosen):
            chosen.append(spot)
    return len(chosen)


def preprocess(
    sequence: ScanSequence,
    gravity: NDArray[np.float64] | None,
    config: PreprocessConfig,
    R_base_sensor: NDArray[np.float64] | None = None,
    ranking: AlignmentConfig = RANKING,
) -> PreparedQuery | None:
    """Prepares a query. Returns None if too few points are left.

    Args:
        gravity: (3,) direction of gravity in the last scan's sensor frame; None: estimated from the
            surfaces, for every scan. A scan that the robot has levelled stays as it is.
        R_base_sensor: (3, 3) mounting on a robot that stands nearly upright: up is estimated near the robot's
            z. None: near the sensor's z.
    """
    scans = []
    # the motion that is solved is the last scan's
    still = [replace(scan, time_s=None) for scan in sequence.scans[:-1]]
    for scan, T_last_scan in zip([*still, sequence.scans[-1]], sequence.T_last_scan, strict=True):
        down = None if gravity is None else T_last_scan[:3, :3].T @ gravity
        prepared = _prepare(scan, T_last_scan, down, config, R_base_sensor, ranking)
        if prepared is not None:
            scans.append(prepared)
    if not scans:
        return None
    together = Surface.together([scan.thinned.moved(scan.T_last_scan) for scan in scans])
    counts = ranking.dense_points, ranking.sparse_points
    dense, sparse = (together.at_most(count, config.voxel_m) for count in counts)
    return PreparedQuery(tuple(scans), dense, sparse)


def _returns_at(nearest_m: NDArray[np.float32], cells: NDArray[np.integer]) -> NDArray[np.float32]:
    """The returns (k, 3) of a range view in the given cells, each in the middle of its direction."""
    returns = directions().take(cells, axis=0)
    returns *= nearest_m.take(cells)[:, None]
    return returns


@dataclass(frozen=True)
class _Returns:
    """Returns of one scan within range, from any encoding, in the sensor frame.

    Attributes:
        seen: (p, 3) float32, all points, for the descriptor.
        voxels: (v, 3) float32, some thousand points, one a voxel.
        view: ranges by direction.
        viewed: points of the view; None: a compact scan without times.
    """

    seen: NDArray[np.float32]
    voxels: TimedPoints
    view: RangeView
    viewed: TimedPoints | None = None

    @classmethod
    def of(cls, scan: Scan | CompactScan, config: PreprocessConfig, ranking: AlignmentConfig) -> _Returns:
        timed = TimedPoints(scan.points, sweep_times(scan.time_s))
        near = timed.within_range(config.min_range_m, config.max_range_m)
        if isinstance(scan, CompactScan):
            return cls._of_compact(near, scan.nearest_m, config, ranking)
        means = near.at_most(ranking.voxelled_points).voxel_means(config.voxel_m)
        voxels, viewed = (
            means.by_voxel_hash(config.voxel_m, ranking.dense_points),
            near.at_most(ranking.view_points),
        )
        return cls(near.points, voxels, RangeView.of(viewed.points), viewed)

    @classmethod
    def _of_compact(
        cls,
        timed: TimedPoints,
        nearest_m: NDArray[np.float32],
        config: PreprocessConfig,
        ranking: AlignmentConfig,
    ) -> _Returns:
        near = (nearest_m > config.min_range_m) & (nearest_m < config.max_range_m)
        nearest_m = np.where(near, nearest_m, np.float32(np.inf))
        # the nearest return of every direction fills cells of the descriptor that the voxels leave empty
        seen = np.concatenate([timed.points, _returns_at(nearest_m, np.flatnonzero(near))])
        voxels = timed.by_voxel_hash(config.voxel_m, ranking.dense_points)
        viewed = None if timed.time_s is None else timed_view(timed, nearest_m)
        return cls(seen, voxels, RangeView.of_nearest(nearest_m), viewed)


def _prepare(
    scan: Scan | CompactScan,
    T_last_scan: Matrix,
    down: NDArray[np.float64] | None,
    config: PreprocessConfig,
    R_base_sensor: NDArray[np.float64] | None,
    ranking: AlignmentConfig,
) -> PreparedScan | None:
    returns = _Returns.of(scan, config, ranking)
    voxels = returns.voxels.points
    if len(voxels) < config.min_points:
        return None
    thinned = replace(Surface.around(voxels, -voxels), time_s=returns.voxels.time_s)
    described = scan.described if isinstance(scan, CompactScan) else None
    if described is not None:
        up, height_m = described.up, described.height_m
    else:
        expected = np.array([0.0, 0.0, 1.0]) if R_base_sensor is None else R_base_sensor[2]
        up = estimate_up_near(thinned.normals, expected) if down is None else -down
        height_m = _height_by(up, thinned, config.default_height_m)
    R_level_sensor = levelling_rotation(up)
    return PreparedScan(
        T_last_scan,
        R_level_sensor,
        height_m,
        returns.seen,
        described,
        returns.view,
        thinned,
        returns.viewed,
    )


def _height_by(up: NDArray[np.float64], surface: Surface, default_height_m: float) -> float:
    """Height of the sensor above the floor, for an up direction."""
    R = levelling_rotation(up)
    seen_m = floor_height(turned(surface.points, R), turned(surface.normals, R))
    return default_height_m if seen_m is None else seen_m
