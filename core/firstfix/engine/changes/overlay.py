"""Overlay: what the map says about each return of a scan at a pose, for people who look at an answer."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ... import native
from ...bit_exact.sample import rows_by_chance
from ...errors import CorruptVersion, InvalidScan
from ...scan.compact import CompactScan, ScanDescriptor
from ...scan.reduction import cells_of, nearest_by_direction
from ...scan.scan import Scan
from ...scan.sequence import AnyScan, ScanSequence
from ...transform import Matrix, inverse
from ..config import EngineConfig
from ..index import MapView
from ..registration.align import MapSurface
from .sighting import COARSE_COLUMNS, FINE_POINTS_M

AGREES, CONTRADICTS, UNEXPLAINED = 0, 1, 2
MAX_POINTS = 60_000


@dataclass(frozen=True)
class Overlay:
    """A scan at a pose in a map.

    Attributes:
        points: (n, 3) float32 metres from the sensor, along the map's axes.
        kind: (n,) uint8. AGREES: the return lies on a mapped surface. CONTRADICTS: its ray passes through
            one. UNEXPLAINED: the rest, which nothing in the map explains.
    """

    points: NDArray[np.float32]
    kind: NDArray[np.uint8]


@dataclass(frozen=True)
class OverlayMap:
    """Files of a version that an overlay needs: far less than a query. Thread-safe."""

    config: EngineConfig
    surface: MapSurface
    view: MapView

    @classmethod
    def load(cls, directory: Path) -> OverlayMap:
        """Read a version's files, memory-mapped.

        Raises:
            CorruptVersion: a file is missing or damaged.
        """
        try:
            config = EngineConfig.load(directory)
            surface = MapSurface.load(directory, config.registration)
            return cls(config, surface, MapView.load(directory, config.verification.reach_m))
        except (OSError, EOFError, ValueError, TypeError) as error:
            raise CorruptVersion(f"{directory.name}: {error}") from error

    def overlay(self, scan: AnyScan, T_map_sensor: Matrix) -> Overlay:
        """The scan at a pose. Of a sequence its last scan, of a large scan a part by chance.

        Args:
            T_map_sensor: (4, 4) in the map's own frame.

        Raises:
            InvalidScan: it is a descriptor, which has no points.
        """
        last = scan.scans[-1] if isinstance(scan, ScanSequence) else scan
        if isinstance(last, ScanDescriptor):
            raise InvalidScan("a descriptor has no points to lay over the map")
        returns = self._returns_of(last)
        T_map_level = np.asarray(self.config.T_map_level, np.float64).reshape(4, 4)
        T_level_sensor = inverse(T_map_level) @ T_map_sensor
        kind = np.full(len(returns), UNEXPLAINED, np.uint8)
        kind[self._passes_through(returns, T_level_sensor)] = CONTRADICTS
        kind[self._is_on_surface(returns, T_level_sensor)] = AGREES
        return Overlay(returns @ T_map_sensor[:3, :3].T.astype(np.float32), kind)

    def _returns_of(self, scan: Scan | CompactScan) -> NDArray[np.float32]:
        limits, range_m = self.config.preprocess, np.linalg.norm(scan.points, axis=1)
        seen = np.flatnonzero((range_m > limits.min_range_m) & (range_m < limits.max_range_m))
        if len(seen) > MAX_POINTS:
            seen = seen[rows_by_chance(len(seen), MAX_POINTS)]
        return np.ascontiguousarray(scan.points[seen], np.float32)

    def _is_on_surface(self, returns: NDArray[np.float32], T_level_sensor: Matrix) -> NDArray[np.bool_]:
        grid = self.surface.fine
        at = returns @ T_level_sensor[:3, :3].T + T_level_sensor[:3, 3] - grid.corner
        row = grid.nearest(np.ascontiguousarray(at, np.float32))
        plane = grid.planes[row]
        away_m = np.abs(np.einsum("ij,ij->i", plane[:, :3], at) - plane[:, 3])
        near: NDArray[np.bool_] = (row >= 0) & (away_m <= self.config.registration.inlier_distance_m)
        return near

    def _passes_through(self, returns: NDArray[np.float32], T_level_sensor: Matrix) -> NDArray[np.bool_]:
        """Whether each return lies beyond a mapped point that all rays around it pass through."""
        reach_m = self.view.reach_m
        mapped, gone, _ = native.compare_points(
            self.view.near.tables,
            self.view.far.tables,
            min(FINE_POINTS_M, reach_m),
            reach_m,
            np.ascontiguousarray(T_level_sensor),
            returns,
            COARSE_COLUMNS,
        )
        passed_m = nearest_by_direction(mapped[gone])
        through: NDArray[np.bool_] = np.linalg.norm(returns, axis=1) > passed_m[cells_of(returns)]
        return through
