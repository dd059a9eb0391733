"""Ways that a robot can go from where it stands: straight and level, free of obstacles, on known floor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..retrieval.cascade import Cascade

WAYS_M = (2.0, 4.0, 8.0)
SHORT_WAY_M = 1.0  # where nothing longer helps: a metre on, a scan shows nearly the same
DIRECTIONS = 240
_HALF_WIDTH_M = 0.3  # of the robot
_CLEARANCE_M = 0.5  # before an obstacle
_OWN_M = 0.3  # nearer points are the robot itself
_STEP_M, _SLOPE = 0.25, 0.05  # what rises more above the floor is an obstacle
_HEADROOM_M = 0.3  # above the sensor
_BINS = 720
_APART_M, _APART = 0.75, 0.4  # between goals at the same distance: so much, or this share of the distance
_ON_FLOOR_M = 0.5  # from a template, along the floor and up or down

_angle = np.arange(DIRECTIONS) * (2 * np.pi / DIRECTIONS)
_HEADING = np.stack([np.cos(_angle), np.sin(_angle)], axis=1)  # (directions, 2)


def free_lengths(points: NDArray[np.floating], height_m: float) -> NDArray[np.float64]:
    """Metres (DIRECTIONS,) that a robot can go straight in each direction, from the x axis to the left.

    Args:
        points: (n, 3) on surfaces that are seen from where it stands, in its levelled frame.
        height_m: of the frame's origin above the floor.
    """
    x, y, z = np.asarray(points, np.float64).T
    away = np.hypot(x, y)
    above = z + height_m
    blocks = (above > _STEP_M + _SLOPE * away) & (above < height_m + _HEADROOM_M) & (away > _OWN_M)
    bin_of = ((np.arctan2(y[blocks], x[blocks]) / (2 * np.pi)) % 1.0 * _BINS).astype(np.int64) % _BINS
    nearest = np.full(_BINS, np.inf)
    np.minimum.at(nearest, bin_of, away[blocks])
    filled = np.flatnonzero(np.isfinite(nearest))
    if not len(filled):
        return np.full(DIRECTIONS, np.inf)
    off = _angle[:, None] - (filled + 0.5) * (2 * np.pi / _BINS)
    is_hit = (np.abs(np.sin(off)) * nearest[filled] < _HALF_WIDTH_M) & (np.cos(off) > 0)
    hit_m = np.where(is_hit, nearest[filled] * np.cos(off), np.inf)
    return hit_m.min(axis=1) - _CLEARANCE_M


def goals_at(lengths: NDArray[np.float64], way_m: float) -> NDArray[np.float64]:
    """Goals (g, 2) at one distance, in the middles of the open sectors. Wide sectors have several.

    Args:
        lengths: (DIRECTIONS,) of the free ways.
        way_m: distance of the goals.
    """
    is_free = lengths >= way_m
    if not is_free.any():
        return np.empty((0, 2))
    start = 0 if is_free.all() else int(np.argmin(is_free))  # no sector is cut where the circle begins
    order = (start + np.arange(DIRECTIONS)) % DIRECTIONS
    edges = np.flatnonzero(np.diff(is_free[order].astype(np.int8), prepend=0, append=0))
    apart = max(_APART_M, _APART * way_m) / way_m * DIRECTIONS / (2 * np.pi)  # in directions
    chosen = [
        order[part[len(part) // 2]]
        for first, end in zip(edges[::2], edges[1::2], strict=True)
        for part in np.array_split(np.arange(first, end), max(1, round((end - first) / apart)))
    ]
    return way_m * _HEADING[chosen]


@dataclass(frozen=True)
class Floor:
    """Floor on which robots can stand, around one place: that of the templates there.

    Attributes:
        spots: (n, 3) metres on the floor, in the index's frame.
        spacing_m: between templates.
    """

    spots: NDArray[np.float64]
    spacing_m: float

    @classmethod
    def around(cls, cascade: Cascade, spacing_m: float, centre: NDArray[np.float64]) -> Floor:
        """Floor within reach of the longest way from a (3,) centre."""
        templates = cascade.templates
        reach_m = WAYS_M[-1] + spacing_m + _ON_FLOOR_M
        rows = cascade.tiles.within(templates.position_m, centre, reach_m)
        spots = np.array(templates.position_m[rows], np.float64)
        spots[:, 2] -= templates.height_m[rows]
        return cls(spots, spacing_m)

    def carries(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Whether a robot can stand at each of (p, 3) points of the floor."""
        if not len(self.spots):
            return np.zeros(len(points), np.bool_)
        off = points[:, None] - self.spots
        reach_m = max(_ON_FLOOR_M, self.spacing_m)
        is_near = (np.hypot(off[..., 0], off[..., 1]) <= reach_m) & (np.abs(off[..., 2]) <= _ON_FLOOR_M)
        return np.asarray(is_near.any(axis=1))
