"""Simulates changes between the map and the world of a scan: unmapped surfaces, and things that have left.

A mapping run misses surfaces, such as the back of a shelf or a room that it saw only through the door. Later,
mapped things leave. The mesh of the map shows neither, so a scan that is simulated in it fits the map better
than a real scan does.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from firstfix.builds.config import PerturbConfig
from firstfix.sensor import SensorModel
from firstfix.transform import Matrix, make_transform, rotation_z

from .boxes import Boxes
from .rays import Rays
from .simulate import Simulator, upright

_COLUMNS, _RISES = 180, 128  # grid over azimuth and height that separates holes from the sky
_COMPARED_RAYS = 96
_SECTORS = (1, 3)  # least and largest number of sectors with missed surfaces
_WIDEST = 0.5  # of the full circle: most of a place has been mapped
_LEFT_SAMPLE = 4096  # rays to choose from
_LEFT_AWAY_M = 1.0  # least distance from the sensor of a thing that leaves
_LEFT_OVER_SENSOR_M = 1.0  # its greatest height over the sensor: ceilings do not leave
_LEFT_HALF_M = (0.2, 0.6)  # half an edge, for each root of a metre of the median range: a chair, a car
_LEFT_SCALE_M = (1.0, 16.0)  # limits of that median
_KEPT_FLOOR_M = 0.15  # the floor below a thing that leaves remains


@dataclass(frozen=True)
class Sight:
    """View of a clean scan in the mesh of the map.

    Attributes:
        T_level_sensor: (4, 4).
        rays: n rays of the sensor, turned to the level frame.
        ranges: (n,) metres, inf where there is no return.
    """

    T_level_sensor: Matrix
    rays: Rays
    ranges: NDArray[np.float32]

    @property
    def origin_m(self) -> NDArray[np.float64]:
        """(3,) origin of the rays."""
        origin: NDArray[np.float64] = self.T_level_sensor[:3, 3]
        return origin

    def ends_m(self, rows: NDArray[np.intp], ranges: NDArray[np.float32]) -> NDArray[np.float64]:
        """(k, 3) ends of the given rays, by (n,) ranges of all rays."""
        return self.origin_m + self.rays.directions[rows] * ranges[rows, None].astype(np.float64)

    @cached_property
    def _cells(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """(n,) column by azimuth and row by height of each ray."""
        x, y, z = self.rays.directions.T
        column = ((np.arctan2(y, x) / np.float32(2 * np.pi) + 0.5) * _COLUMNS).astype(np.intp) % _COLUMNS
        return column, ((z + 1) / 2 * (_RISES - 1)).astype(np.intp)

    def holes(self, ranges: NDArray[np.float32]) -> NDArray[np.bool_]:
        """(n,) which of n rays meet nothing, but pass below a surface: holes of the map, not the sky."""
        met = np.isfinite(ranges)
        column, rise = self._cells
        is_met = np.zeros((_COLUMNS, _RISES + 1), bool)
        is_met[column[met], rise[met]] = True
        is_met_above = np.logical_or.accumulate(is_met[:, ::-1], axis=1)[:, ::-1]
        return ~met & is_met_above[column, rise + 1]


def changed_ranges(
    simulator: Simulator,
    sensor: SensorModel,
    sight: Sight,
    elsewhere_m: NDArray[np.float64],
    config: PerturbConfig,
    rng: np.random.Generator,
) -> NDArray[np.float32]:
    """(n,) ranges in a world that has changed since it was mapped.

    Args:
        elsewhere_m: (k, 3) sensor positions at other places, whose views stand for unmapped surfaces.
    """
    severity = rng.uniform(0, 2)  # a quiet night, a rush hour
    left = what_left(sight, int(rng.poisson(config.vanished * severity)), rng)
    ranges = ranges_without(simulator, sensor, sight, left)
    holes = sight.holes(sight.ranges)
    if config.unmapped and holes.any() and len(elsewhere_m):
        width = config.unmapped * rng.exponential() * float(holes.mean())
        missed = sight.holes(ranges) | _sectors(sight, holes, min(width, _WIDEST), rng)
        like = _lookalike_ranges(simulator, sensor, sight, elsewhere_m, missed, rng)
        ranges[missed] = np.minimum(ranges[missed], like)
    return ranges


def what_left(sight: Sight, count: int, rng: np.random.Generator) -> Boxes:
    """Boxes around surfaces that the scan sees, from just above the floor upwards."""
    some = rng.integers(len(sight.ranges), size=_LEFT_SAMPLE)
    some = some[np.isfinite(sight.ranges[some])]
    ends = sight.ends_m(some, sight.ranges)
    away_m = np.hypot(*(ends - sight.origin_m)[:, :2].T)
    near = ends[(away_m > _LEFT_AWAY_M) & (ends[:, 2] < sight.origin_m[2] + _LEFT_OVER_SENSOR_M)]
    if not count or not len(near):
        return Boxes.none()
    scale_m = np.clip(np.median(sight.ranges[some]), *_LEFT_SCALE_M)
    centre = near[rng.integers(len(near), size=count)]
    half = np.sqrt(scale_m) * rng.uniform(*_LEFT_HALF_M, (count, 3))
    for middle, extent in zip(centre, half, strict=True):
        below = np.abs(ends[:, :2] - middle[:2]).max(axis=1) < extent[:2].max()
        low, high = ends[below, 2].min() + _KEPT_FLOOR_M, middle[2] + extent[2]
        middle[2], extent[2] = (low + high) / 2, max(high - low, 0) / 2
    return Boxes(centre, half, rng.uniform(-np.pi, np.pi, count))


def ranges_without(
    simulator: Simulator, sensor: SensorModel, sight: Sight, left: Boxes
) -> NDArray[np.float32]:
    """(n,) ranges to the first surface that is in none of the boxes."""
    ranges = sight.ranges.copy()
    within = np.flatnonzero(np.isfinite(ranges))
    while len(left):
        within = within[left.contain(sight.ends_m(within, ranges))]
        if not len(within):
            break
        directions = sight.rays.directions[within]
        ranges[within] = simulator.ranges_beyond(sight.origin_m, directions, ranges[within], sensor)
        within = within[np.isfinite(ranges[within])]
    return ranges


def _lookalike_ranges(
    simulator: Simulator,
    sensor: SensorModel,
    sight: Sight,
    elsewhere_m: NDArray[np.float64],
    missed: NDArray[np.bool_],
    rng: np.random.Generator,
) -> NDArray[np.float32]:
    """(m,) ranges of m missed rays at the most similar place elsewhere, in the best of four headings.

    A mapping run misses surfaces that look like those it has seen: the next room, the next row of shelves.
    Such surfaces confuse places most.

    Args:
        missed: (n,) whether a ray is one of the m.
    """
    turns = [make_transform(rotation_z(turn * np.pi / 2), np.zeros(3)) for turn in range(4)]
    few = rng.integers(len(sight.rays), size=_COMPARED_RAYS)
    seen = Rays.of(sight.rays.directions[few])
    there = [simulator.ranges(upright(elsewhere_m), sensor, seen.turned(turn)) for turn in turns]
    far_m = sensor.max_range_m
    own_m = np.minimum(sight.ranges[few], far_m)
    unlike = [np.abs(np.log(np.minimum(np.concatenate(list(r)), far_m) / own_m)) for r in there]
    turn, place = divmod(int(np.median(unlike, axis=2).argmin()), len(elsewhere_m))
    T = turns[turn].copy()
    T[:3, 3] = elsewhere_m[place]
    return next(simulator.ranges(T[None], sensor, sight.rays.of_rows(missed)))[0]


def _sectors(
    sight: Sight, holes: NDArray[np.bool_], width: float, rng: np.random.Generator
) -> NDArray[np.bool_]:
    """Which of n rays lie in a few sectors of azimuth around holes.

    Args:
        width: 0..1, of all sectors together.
    """
    count = int(rng.integers(_SECTORS[0], _SECTORS[1] + 1))
    x, y, _ = sight.rays.directions.T
    level = np.hypot(x, y)
    middle = rng.choice(np.flatnonzero(holes), count)
    cosine = (np.outer(x, x[middle]) + np.outer(y, y[middle])) / np.maximum(level[middle], 1e-6)
    return (cosine > np.cos(np.pi * width / count) * level[:, None]).any(axis=1)
