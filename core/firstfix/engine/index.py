"""Index of one map version: its configuration, retrieval, surface and free space."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ..errors import CorruptVersion
from ..transform import Matrix
from .config import EngineConfig
from .false_accept_bound import FalseAcceptBound
from .ranking import Calibration
from .registration.align import MapSurface
from .retrieval.cascade import Cascade
from .verification.free_space import MapView

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
    """

    config: EngineConfig
    calibration: Calibration
    cascade: Cascade
    surface: MapSurface
    view: MapView
    false_accept_bound: FalseAcceptBound = field(default_factory=FalseAcceptBound)

    @property
    def T_map_level(self) -> Matrix:
        """(4, 4) from the index's frame, whose z is up, to the map's."""
        return np.asarray(self.config.T_map_level, np.float64).reshape(4, 4)

    @classmethod
    def load(cls, directory: Path, calibration: Calibration | None = None) -> MapIndex:
        """Reads a version's files. Arrays are memory-mapped.

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
            return cls(
                config,
                calibration,
                Cascade.load(directory, config),
                MapSurface.load(directory, config.registration, config.ranking),
                MapView.load(directory, config.verification.reach_m),
                FalseAcceptBound.load(directory),
            )
        except (OSError, EOFError, ValueError, TypeError, RuntimeError, KeyError) as error:
            raise CorruptVersion(f"{directory.name}: {error}") from error
