"""View from places of a map: how far one sees, and where a template is informative."""

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

from ..execution.chunks import Arrays, SurfaceChange
from ..execution.stage_cache import StageResult
from ..simulation.rays import Rays
from ..simulation.simulate import Simulator, upright
from ..viewpoints.even_sample import FloorPoints, one_per_block
from ..viewpoints.floor_chunks import TileChunk

RAYS = 4000
SHARE = 75  # percentile, over the directions
GROUND_M = 0.3  # returns nearer than this to the floor's height are ground
OPEN_SIDES = 0.75  # a place is open if a larger share of its directions has only ground
MIN_RETURNS = 4  # of RAYS, that are not ground
VIEWPOINTS, VIEWPOINT_CELL_M = 200, 2.0  # sample of viewpoints for the view distance of a map


@dataclass(frozen=True)
class ViewRays:
    """View in all horizontal directions, with few rays.

    Attributes:
        sensor: sensor model with few rays.
        rays: its n rays at heading zero.
        column: (n,) number of each ray's horizontal direction.
    """

    sensor: SensorModel
    rays: Rays
    column: NDArray[np.int64]

    @classmethod
    def of(cls, sensor: SensorModel) -> ViewRays:
        """ViewRays with about RAYS of a sensor's rays."""
        few = sensor.coarser(RAYS)
        rays = Rays.at_any_heading(few)
        columns = round(360 / few.azimuth_step_deg)
        turn = np.arctan2(rays.directions[:, 1], rays.directions[:, 0]) / (2 * np.pi)
        return cls(few, rays, np.rint(turn * columns).astype(np.int64) % columns)

    def ranges(self, simulator: Simulator, positions: NDArray[np.floating]) -> NDArray[np.float32]:
        """(k, n) ranges at (k, 3) positions, inf where there is no return."""
        return np.concatenate(list(simulator.ranges(upright(positions), self.sensor, self.rays)))

    def furthest_m(self, ranges: NDArray[np.float32]) -> NDArray[np.float32]:
        """(columns, k) horizontal distance of the furthest of (k, n) returns in each direction; 0: no return.

        Of a column of beams the furthest return counts, because the nearer ones mostly show the floor.
        """
        level = np.linalg.norm(self.rays.directions[:, :2], axis=1)
        away = np.zeros((int(self.column.max()) + 1, len(ranges)), np.float32)
        np.maximum.at(away, self.column, (np.where(np.isfinite(ranges), ranges, 0) * level).T)
        return away

    def off_ground(
        self, simulator: Simulator, positions: NDArray[np.floating], floor_z: NDArray[np.floating]
    ) -> NDArray[np.float32]:
        """(k, n) ranges at (k, 3) positions over (k,) floors, inf for ground and where there is no return."""
        ranges = self.ranges(simulator, positions)
        met = np.isfinite(ranges)
        height_m = (
            np.where(met, ranges, 0) * self.rays.directions[:, 2] + (positions[:, 2] - floor_z)[:, None]
        )
        return np.where(met & (np.abs(height_m) > GROUND_M), ranges, np.float32(np.inf))

    def at(
        self, simulator: Simulator, positions: NDArray[np.floating], floor_z: NDArray[np.floating]
    ) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """View distance at each of (k, 3) positions over (k,) floors, and whether more than ground is seen.

        Returns:
            (k,) metres: percentile SHARE, over the directions, of the furthest return that is not ground; inf
            if most directions have none. (k,) whether at least MIN_RETURNS returns are not ground.
        """
        ranges = self.off_ground(simulator, positions, floor_z)
        away = self.furthest_m(ranges).astype(np.float64)
        away[away == 0] = np.nan
        closed = np.isnan(away).mean(axis=0) <= OPEN_SIDES
        view_m = np.full(len(positions), np.inf)
        view_m[closed] = np.nanpercentile(away[:, closed], SHARE, axis=0)
        return view_m, np.isfinite(ranges).sum(axis=1) >= MIN_RETURNS


def percentile_m(furthest_m: NDArray[np.float32], sensor: SensorModel) -> float:
    """How far one sees in a map, from the (n,) furthest returns in directions of some viewpoints."""
    seen = furthest_m[furthest_m > 0]
    return float(np.percentile(seen, SHARE)) if len(seen) else sensor.max_range_m


OPEN_SPACING_M = 2.0
OPEN_VIEW_M = 20.0  # from this view distance on, 2 m find as many as 1 m (docs/method.md section 1)
AT_ONCE = 256
REACH_MARGIN_M = 0.1  # above the rounding of single precision


@dataclass(frozen=True)
class PlacesChunk(TileChunk):
    """Looks from some of the places of a tile. Reads the input ``places``."""

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

    def sees(self, change: SurfaceChange, inputs: Mapping[str, StageResult]) -> bool:
        """Whether a ray of a place meets the change."""
        positions, _ = self._places(inputs["places"].directory)
        rays = ViewRays.of(self.sensor).rays
        return change.is_met(positions, rays, self._reach_m, self.sensor.max_range_m)

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
        """The furthest return in all directions of all places: of all, and of all but the ground."""
        simulator = self.simulator(inputs["mesh"], self._reach_m)
        positions, floor_z = self._places(inputs["places"])
        rays = ViewRays.of(self.sensor)
        return {
            "furthest_m": rays.furthest_m(rays.ranges(simulator, positions)).ravel(),
            "off_ground_m": rays.furthest_m(rays.off_ground(simulator, positions, floor_z)).ravel(),
        }


@dataclass(frozen=True)
class InformativeViewpoints(PlacesChunk):
    """Choice of the informative places: those that show more than ground, and more than their neighbours.

    Attributes:
        first, last: rows of the places, which are those of the tile.
    """

    first: int
    last: int

    @property
    def _rows(self) -> slice:
        return slice(self.first, self.last)

    def run(self, inputs: Mapping[str, Path]) -> Arrays:
        """Which places to keep. What becomes of a block of OPEN_SPACING_M depends on what is seen."""
        positions, floor_z = self._places(inputs["places"])
        block, standing = one_per_block(FloorPoints.alone(positions[:, :2], floor_z), OPEN_SPACING_M)
        simulator = self.simulator(inputs["mesh"], self._reach_m)
        rays = ViewRays.of(self.sensor)
        looks = [
            rays.at(simulator, positions[rows], floor_z[rows])
            for rows in (standing[i : i + AT_ONCE] for i in range(0, len(standing), AT_ONCE))
        ]
        view_m, informative = (np.concatenate(column) for column in zip(*looks, strict=True))
        keep = np.zeros(len(positions), np.bool_)
        keep[standing] = True
        keep |= (view_m < OPEN_VIEW_M)[block]
        keep &= informative[block]
        return {"keep": keep}
