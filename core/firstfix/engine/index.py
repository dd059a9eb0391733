"""One published version, loaded: the cascade, the map's surface and the parameters that made them."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..errors import CorruptVersion
from ..transform import Matrix
from .calibration import Calibration
from .config import EngineConfig
from .registration.align import MapSurface
from .retrieval.cascade import Cascade
from .verification.free_space import MapView

ENGINE_FILE = "engine.json"
CALIBRATION_FILE = "calibration.json"
MAP_FILE = "map_points.npy"  # for pictures; queries use what was made of them


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
            return cls(
                config,
                calibration,
                Cascade.load(directory, config),
                MapSurface.load(directory, config.registration),
                MapView.load(directory, config.verification.reach_m),
            )
        except (OSError, EOFError, ValueError, TypeError, RuntimeError, KeyError) as error:
            raise CorruptVersion(f"{directory.name}: {error}") from error
