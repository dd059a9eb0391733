"""A map without ground: no floor below the poses, or no level surface at the foot of its walls."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from firstfix.findings.finding import Finding
from firstfix.findings.map_kinds import MAP_NO_GROUND

from .columns import BIN_M, FILLED
from .floors_under import FloorsUnder
from .map_places import BELOW_M, MapPlaces
from .told_places import in_words, marked

# Of the poses with a floor below them, of right maps nearly all; of the places with a level surface at their
# foot, of right maps half and more.
LEAST_LEVEL = 0.4
BARE_PLACES = 0.5  # where the poses tell it: so many places agree
MIN_POSES = 5
# Of a map whose walls show in few places so few points are left that no floor would show either.
MIN_WALLED, MIN_WALLED_SHARE = 35, 0.08
_WALL_M = (0.6, 2.1)  # over the ground
_STRETCH_M = 0.25  # of a wall, with points
_FLOOR_M = 0.8  # over the lowest points around: ground slopes
_THICK = 4
MIN_POINTS_A_CELL = 1.0  # in the middle of all places: of a thinner map no floor fills its cells
STOREY_M, _SAME_PLACE_M = 2.0, 6.0  # between the poses of two storeys, and across: ways in them differ


def check_ground(under: FloorsUnder | None, places: MapPlaces, origin: NDArray[np.float64]) -> Finding | None:
    """Finding of a map without ground.

    Args:
        under: of the trajectory, if there is one.
        places: of the map.
        origin: (3,) what brings coordinates of the map to those of the file.
    """
    if _is_thin(places):
        return None
    bare = _bare(places)
    if under is not None and len(under.at) >= MIN_POSES:
        if bare.mean() < BARE_PLACES:
            return None  # there is ground, and poses that are not over it are no poses of this map
        lowest = _lowest(under.at)
        bare = ~np.isfinite(under.height_m[lowest])
        at, what = under.at[lowest], "poses"
    else:
        walled = _walled(places)
        if walled.sum() < max(MIN_WALLED, MIN_WALLED_SHARE * len(walled)):
            return None
        at, what = places.at, "places that have points"
    share = float(bare.mean())
    if share <= 1 - LEAST_LEVEL:
        return None
    told = marked(at[bare], origin)
    numbers = {"bare_share": share, "count": len(at)}
    return MAP_NO_GROUND.found(numbers, what=what, near=in_words(told)).at(told)


def _lowest(at: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether (m,) of (m, 3) positions have none a storey below: that storey's ceiling looks like a floor."""
    near = cKDTree(at[:, :2]).query_pairs(_SAME_PLACE_M, output_type="ndarray")
    lower, upper = np.take_along_axis(near, np.argsort(at[near, 2], axis=1), axis=1).T
    is_lowest = np.ones(len(at), bool)
    is_lowest[upper[at[upper, 2] - at[lower, 2] > STOREY_M]] = False
    return is_lowest


def _is_thin(places: MapPlaces) -> bool:
    """Whether most columns have fewer points than cells: with a floor or without, they show none."""
    cells = places.columns.met.shape[2]
    return bool(np.median(places.columns.count.sum(axis=1)) < MIN_POINTS_A_CELL * cells)


def _bare(places: MapPlaces) -> NDArray[np.bool_]:
    """Whether (k,) there is no level surface near the lowest points."""
    floor = places.columns.filled(_THICK)[:, : round((BELOW_M + _FLOOR_M) / BIN_M)]
    return floor.max(axis=1) < FILLED


def _walled(places: MapPlaces) -> NDArray[np.bool_]:
    """Whether (k,) some cells have points at all heights of a wall."""
    first, last = (round((BELOW_M + at) / BIN_M) for at in _WALL_M)
    bins = round(_STRETCH_M / BIN_M)
    met = places.columns.met[:, first:last]
    stretches = met.reshape(len(met), -1, bins, met.shape[2]).any(axis=2)
    return (stretches.sum(axis=1) >= stretches.shape[1] - 1).sum(axis=1) >= 2
