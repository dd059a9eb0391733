"""Floors that are in a map twice, one above the other: a loop of the mapping run was not closed in height.

Poses that pass one place at two heights, with a floor below each, prove it: a robot keeps its height over the
floor. Without such poses, two level layers that cover one another in most of a place do, with nothing
between: below a step, a raised floor or a kerb no scanner sees, and tables and shelves cover a part.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from firstfix.bit_exact.sample import rows_by_chance
from firstfix.findings.finding import Finding
from firstfix.findings.map_kinds import MAP_DOUBLED_FLOORS

from .columns import BIN_M, Columns
from .map_places import BELOW_M, MapPlaces
from .told_places import in_words, marked

LEAST_M, MOST_M = 0.12, 0.8  # lower is noise, higher a storey of its own
# Poses.
NEAR_M, STEEP = 0.6, 0.2  # a ramp rises between two poses that are not at one place
AWAY_M = 4.0  # along the way
_SHAKEN_M = 0.03  # a robot that stands still, and noise of its poses
MIN_PROVEN, PROVEN_SHARE = 4, 0.3  # of the places that were passed at two heights
_PLACE_M, _SAMPLED_POSES, _SAMPLED_PAIRS = 1.0, 3000, 300
_LOW_M, _HIGH_M, _FLOOR_M = -5.0, 1.0, 0.3  # over the lower pose: what is looked at, the highest floor
_OFF_M, _OFF_SHARE = 0.05, 0.15  # of the layers' distance from the poses': far floors are seen from elsewhere
# Layers.
LEAST_APART_M, SPACINGS = 0.18, 1.5  # a thinned map has layers of its own, one voxel apart
MOST_APART_M = 0.7  # tables are higher
NEARLY = 0.7  # of the largest layer at the place
COVERING, BETWEEN = 0.6, 0.5  # of it: where both layers are, at most what is between
DOUBLED_SHARE, MIN_PLACES = 0.15, 8
EXACT_M = 0.01  # a drawn slab's two faces are everywhere equally far apart
_THICK, _APART = 2, 2


def check_doubled_floors(
    points: NDArray[np.float64],
    poses: NDArray[np.float64] | None,
    places: MapPlaces,
    spacing_m: float,
    origin: NDArray[np.float64],
) -> Finding | None:
    """Finding of a map in which floors lie twice, with share, distance and places.

    Args:
        points: (n, 3) of the map.
        poses: (m, 4, 4) T_map_sensor.
        spacing_m: of the points.
        origin: (3,) what brings coordinates of the map to those of the file.
    """
    found = None if poses is None else _passed_twice(points, poses[:, :3, 3])
    by = "the trajectory passes them twice at other heights"
    if found is None:
        found, by = _in_two_layers(places, spacing_m), "with nothing between"
    if found is None:
        return None
    at, apart_m, share = found
    order = np.argsort(-apart_m)
    told = marked(at[order], origin)
    numbers = {
        "doubled_share": share,
        "apart_m": float(np.median(apart_m)),
        "largest_m": float(apart_m.max()),
        "count": len(at),
    }
    return MAP_DOUBLED_FLOORS.found(numbers, near=in_words(told), by=by).at(told)


_Found = tuple[NDArray[np.float64], NDArray[np.float64], float]  # places, distances, share


def _passed_twice(points: NDArray[np.float64], way: NDArray[np.float64]) -> _Found | None:
    at = way[rows_by_chance(len(way), _SAMPLED_POSES)]
    pairs = cKDTree(at[:, :2]).query_pairs(NEAR_M, output_type="ndarray")
    along_m = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(at, axis=0), axis=1))])
    pairs = pairs[~_climbs(at)[pairs].any(axis=1)]
    first, second = pairs[np.abs(np.subtract(*along_m[pairs.T])) > AWAY_M].T
    apart_m = np.abs(at[first, 2] - at[second, 2])
    middle = (at[first] + at[second]) / 2
    middle[:, 2] = np.minimum(at[first, 2], at[second, 2])
    storey = apart_m < MOST_M
    middle, apart_m, first, second = middle[storey], apart_m[storey], first[storey], second[storey]
    place = np.floor(middle[:, :2] / _PLACE_M).astype(np.int64)
    high = apart_m > LEAST_M + STEEP * np.linalg.norm(at[first, :2] - at[second, :2], axis=1)
    _, one_each = np.unique(place[high], axis=0, return_index=True)
    rows = np.flatnonzero(high)[one_each]
    high_share = len(rows) / max(len(np.unique(place, axis=0)), 1)
    rows = rows[rows_by_chance(len(rows), _SAMPLED_PAIRS)]
    if len(rows) < MIN_PROVEN:
        return None
    layers = Columns.at(points, middle[rows], _LOW_M, _HIGH_M).layers(_THICK, _APART)
    proven = np.zeros(len(rows), bool)
    for number, row in enumerate(rows):
        heights_m = layers.height_m[layers.column == number]
        gaps_m = heights_m - heights_m[heights_m < _FLOOR_M, None]
        off_m = _OFF_M + _OFF_SHARE * apart_m[row]
        proven[number] = bool((np.abs(gaps_m - apart_m[row]) < off_m).any())
    if proven.sum() < max(MIN_PROVEN, PROVEN_SHARE * len(rows)):
        return None
    return middle[rows[proven]], apart_m[rows[proven]], high_share * float(proven.mean())


def _climbs(way: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether (m,) of (m, 3) poses are on stairs: up and down them, a place has all heights."""
    step = np.diff(way, axis=0)
    is_steep = np.abs(step[:, 2]) > STEEP * np.linalg.norm(step[:, :2], axis=1) + _SHAKEN_M
    climbs: NDArray[np.bool_] = np.append(is_steep, False) | np.append(False, is_steep)
    return climbs


def _in_two_layers(places: MapPlaces, spacing_m: float) -> _Found | None:
    columns = places.columns
    layers = columns.layers(_THICK, _APART)
    filled = columns.filled(_THICK)
    least_m = max(LEAST_APART_M, SPACINGS * spacing_m)
    apart_m = np.full(len(places.at), np.nan)
    with_layer = np.unique(layers.column)
    for column in with_layer:
        heights_m = layers.height_m[layers.column == column]
        shares = layers.filled[layers.column == column]
        most = shares.max()
        if len(heights_m) < 2 or not least_m < heights_m[1] - heights_m[0] < MOST_APART_M:
            continue
        low, high = (int((at_m + BELOW_M) / BIN_M) for at_m in heights_m[:2])
        covering = (_near(columns.met[column], low) & _near(columns.met[column], high)).mean()
        between = filled[column, (low + high) // 2]
        if shares[:2].min() >= NEARLY * most and covering >= COVERING * most and between < BETWEEN * most:
            apart_m[column] = heights_m[1] - heights_m[0]
    doubled = np.isfinite(apart_m)
    share = doubled.sum() / max(len(with_layer), 1)
    if doubled.sum() < MIN_PLACES or share < DOUBLED_SHARE or np.std(apart_m[doubled]) < EXACT_M:
        return None
    return places.at[doubled], apart_m[doubled], float(share)


def _near(met: NDArray[np.bool_], number: int) -> NDArray[np.bool_]:
    """Cells (c,) of (b, c) with points in a bin or beside it."""
    near: NDArray[np.bool_] = np.any(met[max(number - 1, 0) : number + 2], axis=0)
    return near
