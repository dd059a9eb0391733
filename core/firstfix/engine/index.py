"""Index of one map version: its configuration, retrieval, surface and free space."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .. import native
from ..errors import CorruptVersion
from ..scan.reduction import RangeView
from ..transform import Matrix
from .calibration import Calibration
from .config import EngineConfig
from .false_accept_bound import FalseAcceptBound
from .made_of import MadeOf, always
from .registration.align import MapSurface
from .retrieval.alias_table import AliasTable
from .retrieval.cascade import Cascade
from .verification.point_tiles import PointTiles
from .verification.seen_free import SeenFree

NEAR_VOXEL_M, FAR_VOXEL_M = 0.2, 0.4  # of the map's points: at 6 and at 12 m a cell is as wide
_NEAR_FILE, _FAR_FILE = "view_near.safetensors", "view_far.safetensors"


@dataclass(frozen=True)
class FreeSpaceShares:
    """Shares, 0..1, of the directions of a scan that pass through a surface of the map.

    Attributes:
        free_space_violation: the scan's return lies where the map has nothing.
        removed_surface: the scan's return lies near another surface of the map.
        seen_free: share of the scan's points in space that the mapping run saw free; None: not known.
    """

    free_space_violation: float
    removed_surface: float
    seen_free: float | None = None


@dataclass(frozen=True)
class MapView:
    """Map points to look at from a pose, direction by direction. Thread-safe.

    Attributes:
        near: fine points, for surfaces within 9 m.
        far: coarser points, for all surfaces.
        reach_m: distance up to which surfaces are checked.
    """

    near: PointTiles
    far: PointTiles
    reach_m: float

    @classmethod
    def of(cls, points: NDArray[np.floating], reach_m: float, made_of: MadeOf = always) -> MapView:
        """View of a map.

        Args:
            points: (m, 3) metres, of the map.
            reach_m: distance up to which surfaces are checked.
            made_of: of ``PointTiles.of``.
        """
        near, far = (PointTiles.of(points, voxel_m, made_of) for voxel_m in (NEAR_VOXEL_M, FAR_VOXEL_M))
        return cls(near, far, reach_m)

    def save(self, directory: Path) -> None:
        """Write a version's files."""
        self.near.save(directory / _NEAR_FILE)
        self.far.save(directory / _FAR_FILE)

    @classmethod
    def load(cls, directory: Path, reach_m: float) -> MapView:
        """Read a version's files, memory-mapped."""
        return cls(PointTiles.load(directory / _NEAR_FILE), PointTiles.load(directory / _FAR_FILE), reach_m)

    def seen_through(self, surface: MapSurface, scan: RangeView, T_level_sensor: Matrix) -> FreeSpaceShares:
        """Shares of directions in which the scan sees through the map.

        Directions count in which both scan and map have a surface. The scan sees through the map if its
        nearest return in and around the direction lies beyond the map's surface by 0.3 m and 3 %. The return
        lies near another surface if the coarse grid has a point for its cell.

        Args:
            surface: of the same map.

        Returns:
            1 and 0 if scan and map have no direction in common.
        """
        near, far, coarse = self.near.tables, self.far.tables, surface.coarse.tables
        return FreeSpaceShares(
            *native.seen_through(near, far, self.reach_m, coarse, scan.returned, scan.least, T_level_sensor)
        )


CALIBRATION_FILE = "calibration.json"
MAP_FILE = "map_points.npy"  # for pictures; no query reads it


@dataclass(frozen=True)
class MapIndex:
    """Loaded map version, as queries use it. Immutable and thread-safe.

    Attributes:
        config: configuration of the build and of queries.
        calibration: from match features to probabilities.
        cascade: retrieval of templates.
        surface: map to register against.
        view: map to check free space against.
        false_accept_bound: by the threshold on the probability.
        aliases: of the templates; None: the version has none.
        seen_free: space that the mapping run saw free; None: not known.
    """

    config: EngineConfig
    calibration: Calibration
    cascade: Cascade
    surface: MapSurface
    view: MapView
    false_accept_bound: FalseAcceptBound = field(default_factory=FalseAcceptBound)
    aliases: AliasTable | None = None
    seen_free: SeenFree | None = None

    @cached_property
    def T_map_level(self) -> Matrix:
        """(4, 4) from the index's frame, whose z is up, to the map's; read-only."""
        T = np.array(self.config.T_map_level, np.float64).reshape(4, 4)
        T.setflags(write=False)
        return T

    @cached_property
    def searched(self) -> native.SearchedMap:
        """The map as the compiled search reads it."""
        config, seen_free = self.config, self.seen_free
        return native.SearchedMap(
            self.T_map_level,
            self.surface.fine.tables,
            self.surface.coarse.tables,
            self.view.near.tables,
            self.view.far.tables,
            None if seen_free is None else seen_free.tables,
            None if self.cascade is None else self.cascade.places,
            None if self.aliases is None else self.aliases.tables,
            self.view.reach_m,
            config.spacing_m,
            config.registration,
            config.nearby,
            config.search.aliases,
            config.ranking,
            self.calibration,
            config.verification.compared,
            config.search,
            0.0 if self.cascade is None else self.cascade.templates.usual_height_m,
            config.preprocess.default_height_m,
        )

    @classmethod
    def load(cls, directory: Path, calibration: Calibration | None = None) -> MapIndex:
        """Read a version's files. Arrays are memory-mapped.

        Args:
            directory: of the files.
            calibration: to use instead of the version's own, for a build that has not measured it yet.

        Raises:
            IncompatibleVersion: the version was made for another ranking.
            CorruptVersion: a file is missing or damaged.
        """
        try:
            config = EngineConfig.load(directory)
            if calibration is None:
                calibration = Calibration.from_mapping(json.loads((directory / CALIBRATION_FILE).read_text()))
            cascade = Cascade.load(directory, config)
            return cls(
                config,
                calibration,
                cascade,
                MapSurface.load(directory, config.registration, config.ranking),
                MapView.load(directory, config.verification.reach_m),
                FalseAcceptBound.load(directory),
                AliasTable.load(directory, len(cascade.templates)),
                SeenFree.load(directory),
            )
        except (OSError, EOFError, ValueError, TypeError, RuntimeError, KeyError) as error:
            raise CorruptVersion(f"{directory.name}: {error}") from error
