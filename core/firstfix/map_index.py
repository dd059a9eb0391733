"""One published version, loaded: the cascade, the map cloud and the parameters that made them."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .calibration import Calibration
from .cascade import Cascade
from .engine_config import EngineConfig
from .errors import CorruptVersion
from .map_view import MapView
from .registration import MapSurface
from .surface import Surface
from .transform import Matrix

ENGINE_FILE = "engine.json"
CALIBRATION_FILE = "calibration.json"
MAP_FILE, NORMALS_FILE = "map_points.npy", "map_normals.npy"


@dataclass(frozen=True)
class MapIndex:
    """Everything that the query flow needs of a version. Immutable and thread-safe."""

    config: EngineConfig
    calibration: Calibration
    cascade: Cascade
    surface: MapSurface
    view: MapView

    @property
    def T_map_level(self) -> Matrix:
        return np.asarray(self.config.T_map_level, np.float64).reshape(4, 4)

    @classmethod
    def load(cls, directory: Path, calibration: Calibration | None = None) -> MapIndex:
        """Reads a version's files; arrays are memory-mapped.

        Args:
            calibration: in place of the version's own, while a build has not measured it yet.

        Raises:
            CorruptVersion: a file is missing or cannot be read.
        """
        try:
            config = EngineConfig.model_validate_json((directory / ENGINE_FILE).read_text())
            if calibration is None:
                calibration = Calibration.from_mapping(json.loads((directory / CALIBRATION_FILE).read_text()))
            surface = load_surface(directory)
            return cls(
                config,
                calibration,
                Cascade.load(directory, config),
                MapSurface(surface, config.registration),
                MapView(surface.points, config.verification.reach_m),
            )
        except (OSError, ValueError, RuntimeError, KeyError) as error:
            raise CorruptVersion(f"{directory.name}: {error}") from error


def save_surface(surface: Surface, directory: Path) -> None:
    """The map of a version: (m, 4) int8 are the normals by 1/127, half a degree, and whether oriented."""
    normals = np.round(127 * surface.normals)
    np.save(directory / MAP_FILE, surface.points)
    np.save(directory / NORMALS_FILE, np.column_stack([normals, surface.oriented]).astype(np.int8))


def load_surface(directory: Path) -> Surface:
    stored = np.load(directory / NORMALS_FILE)
    normals = stored[:, :3].astype(np.float32)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1)
    return Surface(np.load(directory / MAP_FILE), normals, stored[:, 3].astype(np.bool_))
