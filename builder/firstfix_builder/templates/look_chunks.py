"""Looks from the places of one tile of a map: how far one sees, and where a template tells something."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firstfix.sensor import SensorModel

from ..execution.chunks import Arrays
from ..execution.stage_cache import StageResult
from ..viewpoints.floor_chunks import TileChunk
from ..viewpoints.one_per_block import Spots, one_per_block
from .view_distance import ViewRays

OPEN_SPACING_M = 2.0
OPEN_VIEW_M = 20.0  # from this view distance on, 2 m find as many as 1 m (docs/method.md section 1)
AT_ONCE = 256
REACH_MARGIN_M = 0.1  # above the rounding of single precision


@dataclass(frozen=True)
class PlacesChunk(TileChunk):
    """Looks from some of the places of a tile. Reads the stage ``places``."""

    sensor: SensorModel

    @property
    def values(self) -> dict[str, Any]:
        """The sensor. Rows and tiles say where the places are, and these are read."""
        return {"sensor": asdict(self.sensor)}

    def reads(self, inputs: Mapping[str, StageResult]) -> Mapping[str, str]:
        """Hashes of the places, and of the surface that the sensor can see from there."""
        positions, floor_z = self._places(inputs["places"].directory)
        return {
            "places": sha256(positions.tobytes() + floor_z.tobytes()).hexdigest(),
            "mesh": self.surface(inputs["mesh"], self._reach_m),
        }

    def _places(self, folder: Path) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(n, 3) positions and (n,) heights of the floor."""
        positions, floor_z = (
            np.asarray(np.load(folder / f"{name}.npy", mmap_mode="r")[self._rows])
            for name in ("positions", "floor_z")
        )
        return positions, floor_z

    @property
    @abstractmethod
    def _rows(self) -> slice | list[int]:
        """Rows of the places."""

    @property
    def _reach_m(self) -> float:
        return self.sensor.max_range_m + REACH_MARGIN_M


@dataclass(frozen=True)
class LookChunk(PlacesChunk):
    """Viewing distance from some places.

    Attributes:
        rows: of the places.
    """

    rows: tuple[int, ...]

    @property
    def _rows(self) -> list[int]:
        return list(self.rows)

    def run(self, inputs: Mapping[str, Path]) -> Arrays:
        """Returns the furthest return in all directions of all places: of all, and of all but the ground."""
        simulator = self.simulator(inputs["mesh"], self._reach_m)
        positions, floor_z = self._places(inputs["places"])
        rays = ViewRays.of(self.sensor)
        return {
            "furthest_m": rays.furthest_m(rays.ranges(simulator, positions)).ravel(),
            "off_ground_m": rays.furthest_m(rays.off_ground(simulator, positions, floor_z)).ravel(),
        }


@dataclass(frozen=True)
class InformativeViewpoints(PlacesChunk):
    """Choice of the places that tell something that their neighbours do not.

    Attributes:
        first, last: rows of the places, which are those of the tile.
    """

    first: int
    last: int

    @property
    def _rows(self) -> slice:
        return slice(self.first, self.last)

    def run(self, inputs: Mapping[str, Path]) -> Arrays:
        """Returns which places to keep. What becomes of a block of OPEN_SPACING_M depends on what is seen."""
        positions, floor_z = self._places(inputs["places"])
        block, standing = one_per_block(Spots.alone(positions[:, :2], floor_z), OPEN_SPACING_M)
        simulator = self.simulator(inputs["mesh"], self._reach_m)
        rays = ViewRays.of(self.sensor)
        looks = [
            rays.at(simulator, positions[rows], floor_z[rows])
            for rows in (standing[i : i + AT_ONCE] for i in range(0, len(standing), AT_ONCE))
        ]
        view_m, tells = (np.concatenate(column) for column in zip(*looks, strict=True))
        keep = np.zeros(len(positions), np.bool_)
        keep[standing] = True
        keep |= (view_m < OPEN_VIEW_M)[block]
        keep &= tells[block]
        return {"keep": keep}
