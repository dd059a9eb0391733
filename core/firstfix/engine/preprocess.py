"""Preprocessing: scans are cropped, levelled and thinned, ready to be described and registered."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import native
from ..descriptor import Described, Descriptor, LayeredOccupancy, ScanBatch
from ..native import deskew, turned_occupied_cells
from ..scan.compact import CompactScan, ScanDescriptor
from ..scan.levelling import turned
from ..scan.reduction import RangeView, TimedPoints
from ..scan.scan import Scan
from ..scan.sequence import ScanSequence
from ..transform import Matrix
from .config import PreprocessConfig
from .ranking import RANKING, RankingConfig
from .registration.surface import Surface

_UPRIGHT = np.array([0.0, 0.0, 1.0])


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


class PreparedQuery:
    """Scans of a query, and their points together in the frame of the last scan.

    They stay in the compiled core, which describes, searches and registers them. Arrays are views of its
    memory.

    Attributes:
        compiled: the query as the compiled search reads it.
        in_range: number of the last scan's points within range; of a compact scan, with its returns.
    """

    def __init__(self, compiled: native.PreparedQuery, sequence: ScanSequence) -> None:
        self.compiled, self._sequence = compiled, sequence
        self.in_range = compiled.in_range

    @cached_property
    def scans(self) -> tuple[PreparedScan, ...]:
        """The scans that have enough points."""
        return tuple(self._scan(number) for number in range(len(self.compiled)))

    @cached_property
    def dense(self) -> Surface:
        """Thinned points, for fine alignment."""
        return _surface(*self.compiled.dense())

    @cached_property
    def sparse(self) -> Surface:
        """A part of the thinned points, enough to align and compare many candidates."""
        return _surface(*self.compiled.sparse())

    def _scan(self, number: int) -> PreparedScan:
        asked, T_last_scan, R_level_sensor, height_m, seen, returned, least, returns, thinned = (
            self.compiled.scan(number)
        )
        scan = self._sequence.scans[asked]
        return PreparedScan(
            T_last_scan,
            R_level_sensor,
            height_m,
            seen,
            scan.described if isinstance(scan, CompactScan) else None,
            RangeView(returned.view(np.bool_), least),
            _surface(*thinned),
            None if returns is None else TimedPoints(*returns),
        )


def preprocess(
    sequence: ScanSequence,
    gravity: NDArray[np.float64] | None,
    config: PreprocessConfig,
    R_base_sensor: NDArray[np.float64] | None = None,
    ranking: RankingConfig = RANKING,
    twist: NDArray[np.float64] | None = None,
) -> PreparedQuery | None:
    """Prepares a query. Returns None if too few points are left.

    Compiled: ``native/include/firstfix/query/prepared_query.hpp``.

    Args:
        gravity: (3,) direction of gravity in the last scan's sensor frame; None: estimated from the
            surfaces, for every scan. A scan that the robot has levelled stays as it is.
        R_base_sensor: (3, 3) mounting on a robot that stands nearly upright: up is estimated near the robot's
            z. None: near the sensor's z.
        twist: (6,) m/s then rad/s of the sensor during the last scan, in its frame: the scan is taken as it
            would have been seen at its stamp. None: not known, the scan stays as it is.

    Raises:
        InvalidOption: a twist is given, and the times of the points are not known.
    """
    scans = list(map(_asked, sequence.scans, sequence.T_last_scan))
    up = _UPRIGHT if R_base_sensor is None else R_base_sensor[2]
    compiled = native.prepare(scans, gravity, up, twist, config, ranking)
    return None if compiled is None else PreparedQuery(compiled, sequence)


def _asked(scan: Scan | CompactScan, T_last_scan: Matrix) -> tuple[Any, ...]:
    """A scan as the compiled core reads it."""
    if isinstance(scan, Scan):
        return T_last_scan, scan.points, scan.time_s, None, None
    described, robots = scan.described, None
    if described is not None:
        grid, edges_m = described.descriptor.grid, np.asarray(described.descriptor.edges_m, np.float32)
        form = grid.rings, grid.sectors, grid.max_range_m, edges_m
        robots = (*form, described.occupancy, described.up, described.height_m)
    return T_last_scan, scan.points, scan.time_s, scan.nearest_m, robots


def _surface(
    points: NDArray[np.float32],
    normals: NDArray[np.float32],
    oriented: NDArray[np.uint8],
    time_s: NDArray[np.float32] | None,
) -> Surface:
    return Surface(points, normals, oriented.view(np.bool_), time_s)
