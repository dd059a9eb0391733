"""Viewing distance at places of a map, and the places that see nothing but ground."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from firstfix.sensor import SensorModel

from ..simulation.rays import Rays
from ..simulation.simulate import Simulator, upright

RAYS = 4000
SHARE = 75  # percentile, of the directions
GROUND_M = 0.3  # what is nearer to the floor's height is ground
OPEN_SIDES = 0.75  # of the directions have nothing but ground: then the place is open
LEAST_RETURNS = 4  # of RAYS, from anything but the ground
VIEWPOINTS, VIEWPOINT_CELL_M = 200, 2.0  # that tell how far one sees in a map


@dataclass(frozen=True)
class Outlook:
    """Some rays all round.

    Attributes:
        sensor: whose rays are few.
        rays: its n rays at heading zero.
        column: (n,) number of the direction in the ground plane that each looks into.
    """

    sensor: SensorModel
    rays: Rays
    column: NDArray[np.int64]

    @classmethod
    def of(cls, sensor: SensorModel) -> Outlook:
        """Outlook with some of a sensor's rays."""
        few = sensor.coarser(RAYS)
        rays = Rays.at_any_heading(few)
        columns = round(360 / few.azimuth_step_deg)
        turn = np.arctan2(rays.directions[:, 1], rays.directions[:, 0]) / (2 * np.pi)
        return cls(few, rays, np.rint(turn * columns).astype(np.int64) % columns)

    def ranges(self, simulator: Simulator, positions: NDArray[np.floating]) -> NDArray[np.float32]:
        """(k, n) ranges at (k, 3) positions, inf where nothing returns."""
        return np.concatenate(list(simulator.ranges(upright(positions), self.sensor, self.rays)))

    def furthest_m(self, ranges: NDArray[np.float32]) -> NDArray[np.float32]:
        """(columns, k) level distance of the furthest of (k, n) returns in every direction, 0 without one.

        The furthest of a column of beams: the nearer ones mostly show the floor.
        """
        level = np.linalg.norm(self.rays.directions[:, :2], axis=1)
        away = np.zeros((int(self.column.max()) + 1, len(ranges)), np.float32)
        np.maximum.at(away, self.column, (np.where(np.isfinite(ranges), ranges, 0) * level).T)
        return away

    def off_ground(
        self, simulator: Simulator, positions: NDArray[np.floating], floor_z: NDArray[np.floating]
    ) -> NDArray[np.float32]:
        """(k, n) ranges at (k, 3) positions over (k,) floors, inf where nothing but ground returns."""
        ranges = self.ranges(simulator, positions)
        met = np.isfinite(ranges)
        height_m = (
            np.where(met, ranges, 0) * self.rays.directions[:, 2] + (positions[:, 2] - floor_z)[:, None]
        )
        return np.where(met & (np.abs(height_m) > GROUND_M), ranges, np.float32(np.inf))

    def at(
        self, simulator: Simulator, positions: NDArray[np.floating], floor_z: NDArray[np.floating]
    ) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Viewing distance at each of (k, 3) positions over (k,) floors, and where more than ground is seen.

        Returns:
            (k,) the percentile SHARE of what is furthest in every direction but the ground, metres, inf where
            most directions have nothing; (k,) whether so much as LEAST_RETURNS rays meet anything but ground.
        """
        ranges = self.off_ground(simulator, positions, floor_z)
        away = self.furthest_m(ranges).astype(np.float64)
        away[away == 0] = np.nan
        closed = np.isnan(away).mean(axis=0) <= OPEN_SIDES
        view_m = np.full(len(positions), np.inf)
        view_m[closed] = np.nanpercentile(away[:, closed], SHARE, axis=0)
        return view_m, np.isfinite(ranges).sum(axis=1) >= LEAST_RETURNS


def percentile_m(furthest_m: NDArray[np.float32], sensor: SensorModel) -> float:
    """Returns how far one sees in a map, from the furthest returns in directions of some viewpoints."""
    seen = furthest_m[furthest_m > 0]
    return float(np.percentile(seen, SHARE)) if len(seen) else sensor.max_range_m
