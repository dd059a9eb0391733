"""Preprocessing: scans are cropped, levelled and thinned, ready to be described and registered."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from .. import native
from ..descriptor import Described, Descriptor, LayeredOccupancy, ScanBatch
from ..errors import InvalidOption
from ..native import (
    deskew,
    prepare_compact_scan,
    prepare_scan,
    turned_occupied_cells,
)
from ..scan.compact import CompactScan, ScanDescriptor
from ..scan.levelling import turned
from ..scan.reduction import RangeView, TimedPoints, directions, nearest_by_direction
from ..scan.scan import Scan
from ..scan.sequence import ScanSequence
from ..transform import Matrix
from .config import PreprocessConfig
from .ranking import RANKING, AlignmentConfig
from .registration.surface import SAME_FRAME, Surface


def timed_view(timed: TimedPoints, nearest_m: NDArray[np.float32]) -> TimedPoints:
    """The returns of a range view, each in the middle of its direction.

    Its time is the mean of those of the points in its column. A spinning sensor sees a column at one time.
    The times of any other one are spread over its columns: their mean then changes little.

    Args:
        timed: points of the scan, with times.
        nearest_m: (cells,) nearest ranges by direction, infinite where nothing returned.
    """
    assert timed.time_s is not None
    return TimedPoints(*native.timed_view(timed.points, timed.time_s, nearest_m, directions()))


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
    scans, sparse = [], None
    # the motion that is solved is the last scan's
    still = [replace(scan, time_s=None) for scan in sequence.scans[:-1]]
    for scan, T_last_scan in zip([*still, sequence.scans[-1]], sequence.T_last_scan, strict=True):
        down = None if gravity is None else _in_scan(T_last_scan, gravity)
        made = _prepare(scan, T_last_scan, down, config, R_base_sensor, ranking)
        if made is not None:
            prepared, sparse = made
            scans.append(prepared)
    if not scans:
        return None
    if len(scans) == 1 and not (scans[0].T_last_scan != SAME_FRAME).any():
        return PreparedQuery(tuple(scans), scans[0].thinned, scans[0].thinned if sparse is None else sparse)
    dense, few = native.joined_scans(
        [(one.T_last_scan, *_numbers(one.thinned)) for one in scans],
        config.voxel_m,
        ranking.dense_points,
        ranking.sparse_points,
    )
    return PreparedQuery(tuple(scans), _surface(*dense), _surface(*few))


def _in_scan(T_last_scan: Matrix, direction: NDArray[np.float64]) -> NDArray[np.float64]:
    """A direction (3,) of the last scan in a scan's frame, the same bits on every processor."""
    R, (x, y, z) = T_last_scan[:3, :3], direction
    turned_back: NDArray[np.float64] = R[0] * x + R[1] * y + R[2] * z
    return turned_back


def _prepare(
    scan: Scan | CompactScan,
    T_last_scan: Matrix,
    down: NDArray[np.float64] | None,
    config: PreprocessConfig,
    R_base_sensor: NDArray[np.float64] | None,
    ranking: AlignmentConfig,
) -> tuple[PreparedScan, Surface | None] | None:
    """The scan, and a part of its points to align with many candidates; None: it has no more than these."""
    described = scan.described if isinstance(scan, CompactScan) else None
    if described is not None:
        up = described.up
    elif down is not None:
        up = -down
    else:  # expected
        up = np.array([0.0, 0.0, 1.0]) if R_base_sensor is None else R_base_sensor[2]
    is_known = described is not None or down is not None
    limits = config.min_range_m, config.max_range_m, config.voxel_m, config.min_points
    numbers = ranking.dense_points, ranking.sparse_points
    if isinstance(scan, CompactScan):
        made = prepare_compact_scan(
            scan.points,
            scan.time_s,
            scan.nearest_m,
            directions(),
            *limits,
            *numbers,
            up=up,
            up_is_known=is_known,
            height_m=None if described is None else described.height_m,
            default_height_m=config.default_height_m,
        )
    else:
        made = prepare_scan(
            scan.points,
            scan.time_s,
            *limits,
            ranking.voxelled_points,
            ranking.view_points,
            *numbers,
            up=up,
            up_is_known=is_known,
            default_height_m=config.default_height_m,
        )
    if made is None:
        return None
    R_level_sensor, height_m, seen, returned, least_m, viewed, dense, sparse = made
    thinned = _surface(*dense)
    returns = None if viewed is None else TimedPoints(*viewed)
    if isinstance(scan, CompactScan) and thinned.time_s is not None:
        returns = _timed_returns(scan, config)
    prepared = PreparedScan(
        T_last_scan,
        R_level_sensor,
        height_m,
        seen,
        described,
        RangeView(returned.view(np.bool_), least_m),
        thinned,
        returns,
    )
    return prepared, None if sparse is None else _surface(*sparse)


_Floats: TypeAlias = NDArray[np.float32]


def _numbers(surface: Surface) -> tuple[_Floats, _Floats, NDArray[np.bool_], _Floats | None]:
    return surface.points, surface.normals, surface.oriented, surface.time_s


def _surface(
    points: NDArray[np.float32],
    normals: NDArray[np.float32],
    oriented: NDArray[np.uint8],
    time_s: NDArray[np.float32] | None,
) -> Surface:
    return Surface(points, normals, oriented.view(np.bool_), time_s)


def _timed_returns(scan: CompactScan, config: PreprocessConfig) -> TimedPoints:
    """The returns of a compact scan's range view within range, with their times."""
    near = TimedPoints(scan.points, scan.time_s).within_range(config.min_range_m, config.max_range_m)
    in_range = (scan.nearest_m > config.min_range_m) & (scan.nearest_m < config.max_range_m)
    return timed_view(near, np.where(in_range, scan.nearest_m, np.float32(np.inf)))
