"""Results of the stages, each with what it holds: who reads a stage names no file of it."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firstfix.engine.calibration import Calibration
from firstfix.engine.config import EngineConfig
from firstfix.engine.index import CALIBRATION_FILE, MAP_FILE, MapIndex
from firstfix.transform import Matrix, inverse, transform_points

from .execution.stage_cache import StageResult
from .mesh.clean_cloud import point_spacing_m
from .mesh.intensity import Intensity
from .rebuild.kept import Kept
from .simulation.local_simulator import whole_simulator
from .simulation.simulate import Simulator
from .stage_files import TRAJECTORY_FILE
from .viewpoints.left_out_floor import SeenFloor

POINTS_FILE, TRIANGLES_FILE = "points.npy", "triangles.npy"  # of ``TiledPoints`` and ``Mesh``
T_MAP_LEVEL_FILE = "T_map_level.npy"
FINDINGS_FILE, MOVING_FILE, SESSIONS_FILE = "findings.json", "moving.json", "sessions.json"
INTENSITY_FILE = "point_intensity.npz"  # of ``Intensity``
POSITIONS_FILE, CHUNK_START_FILE = "positions.npy", "chunk_start.npy"
SPACING_FILE, VIEW_FILE = "spacing_m.npy", "view_m.npy"
REPORT_FILE = "self_test.json"  # of a version


@dataclass(frozen=True)
class LevelMap(StageResult):
    """The map of a source in its levelled local frame: a cloud or a mesh."""

    @property
    def is_mesh(self) -> bool:
        """Whether the source is a mesh, and not a cloud."""
        return (self.directory / TRIANGLES_FILE).exists()

    @property
    def points(self) -> NDArray[np.float64]:
        """(n, 3) metres, of a cloud."""
        return _array(self.directory / POINTS_FILE)

    @property
    def mapped_points(self) -> NDArray[np.float64]:
        """(n, 3) ``points``, memory-mapped."""
        return _array(self.directory / POINTS_FILE, mapped=True)

    @property
    def intensity(self) -> Intensity | None:
        """Intensity of ``points``, or None if the source has none."""
        path = self.directory / INTENSITY_FILE
        return Intensity.load(path) if path.exists() else None

    @property
    def spacing_m(self) -> float:
        """Spacing of the points of a cloud."""
        return point_spacing_m(self.points)

    @property
    def trajectory(self) -> NDArray[np.float64] | None:
        """(m, 4, 4) poses of the mapping run, or None if the map has none."""
        path = self.directory / TRAJECTORY_FILE
        return _array(path) if path.exists() else None

    @property
    def T_map_level(self) -> Matrix:
        """(4, 4) to the coordinates of the source."""
        return _array(self.directory / T_MAP_LEVEL_FILE)

    @property
    def findings(self) -> list[dict[str, Any]]:
        """Findings of the map, as JSON values."""
        return _json(self.directory / FINDINGS_FILE)

    @property
    def marked_places(self) -> dict[str, NDArray[np.float64]]:
        """Places (n, 3) of the map's findings by their codes, in the level frame."""
        T_level_map = inverse(self.T_map_level)
        return {
            one["code"]: transform_points(T_level_map, np.array(one["places"], np.float64))
            for one in self.findings
            if one.get("places")
        }

    @property
    def moving(self) -> dict[str, Any] | None:
        """Figures of ``without_moving``, or None if the map brought no mapping scans."""
        path = self.directory / MOVING_FILE
        return _json(path) if path.exists() else None

    @property
    def sessions(self) -> list[dict[str, Any]] | None:
        """Record of each session that was merged; None: the source has no sessions."""
        path = self.directory / SESSIONS_FILE
        return _json(path) if path.exists() else None


@dataclass(frozen=True)
class MapMesh(StageResult):
    """The surface of a map, in tiles."""

    @property
    def simulator(self) -> Simulator:
        """A simulator over the whole mesh."""
        return whole_simulator(self.directory)


@dataclass(frozen=True)
class MapViewpoints(StageResult):
    """The sensor positions of the templates, in the order in which these are made."""

    @property
    def positions(self) -> NDArray[np.float64]:
        """(n, 3) in the level frame."""
        return _array(self.directory / POSITIONS_FILE)

    @property
    def chunk_start(self) -> NDArray[np.int64]:
        """Rows at which the tiles of chunks start."""
        return _array(self.directory / CHUNK_START_FILE)

    @property
    def spacing_m(self) -> float:
        """Largest spacing between them."""
        return float(np.load(self.directory / SPACING_FILE))

    @property
    def view_m(self) -> float:
        """How far one sees from them, the ground included."""
        return float(np.load(self.directory / VIEW_FILE))

    @property
    def floor(self) -> SeenFloor | None:
        """The floor that the mapping run saw, or None if the map has no trajectory."""
        return SeenFloor.load(self.directory)


@dataclass(frozen=True)
class FittedEngine(StageResult):
    """The engine's parameters."""

    @property
    def engine(self) -> EngineConfig:
        """Parameters that the version is made with and asked with."""
        return EngineConfig.load(self.directory)


@dataclass(frozen=True)
class IndexFiles(FittedEngine):
    """All files of a version but what the self-test adds."""

    @property
    def map_points(self) -> NDArray[np.float32]:
        """(n, 3) of the surface that is seen from the viewpoints."""
        return _array(self.directory / MAP_FILE)

    def load(self, calibration: Calibration) -> MapIndex:
        """Load the index with a calibration, which it has not yet."""
        return MapIndex.load(self.directory, calibration)


@dataclass(frozen=True)
class SelfTested(StageResult):
    """Result of the self-test, which a version takes in."""

    @property
    def calibration(self) -> Calibration:
        """Its measured figures."""
        return Calibration.from_mapping(_json(self.directory / CALIBRATION_FILE))


@dataclass(frozen=True)
class IndexedMap:
    """A map, from its surface to the index, which has no calibration yet.

    Attributes:
        kept: what the index has of the version before; None: nothing.
    """

    mesh: MapMesh
    viewpoints: MapViewpoints
    index: IndexFiles
    kept: Kept | None = None


def _array(path: Path, *, mapped: bool = False) -> NDArray[Any]:
    found: NDArray[Any] = np.load(path, mmap_mode="r" if mapped else None)
    return found


def _json(path: Path) -> Any:
    return json.loads(path.read_text())
