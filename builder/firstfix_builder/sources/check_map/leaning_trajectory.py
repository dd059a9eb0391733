"""A trajectory that leans against its map: its height over the floor grows evenly in one direction.

Over level floors, ramps and storeys alike, a sensor keeps its height over the floor. So of right poses most
have a level layer at one and the same height below them; of leaning ones, at a height that is a plane over x
and y. The plane is looked for among planes through three layers by chance.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from firstfix.findings.finding import Finding
from firstfix.findings.map_kinds import TRAJECTORY_LEANS

from .floors_under import FloorsUnder
from .told_places import in_words, marked

SAME_M = 0.15  # a hand-held scanner goes up and down
MIN_RISE_M = 0.5
MOST_LEAN_DEG = 30.0
EVEN_SHARE = 0.6  # of the poses at one height: so many do not lean
LEANING_SHARE, MORE = 0.6, 1.5  # at the heights of the plane: of all poses, and times those at one height
_MIN_POSES, _MIN_WAY_M = 8, 4.0
_STRAIGHT_M = 1.0  # a way that is narrower tells nothing of a lean across
_TRIED, _SEED = 1500, 34


def check_lean(under: FloorsUnder, origin: NDArray[np.float64]) -> Finding | None:
    """Finding of poses that lean, with degrees and direction.

    Args:
        origin: (3,) what brings the poses' coordinates to those of the file.
    """
    at, layers = under.at, under.layers.nearly_most(len(under.at))
    if len(at) < _MIN_POSES or not len(layers.column) or np.ptp(at[:, :2], axis=0).max() < _MIN_WAY_M:
        return None
    middle = at[:, :2].mean(axis=0)
    xy, over_m = at[layers.column, :2] - middle, -layers.height_m
    even = _share_at_one_height(layers.column, over_m, len(at))
    if even >= EVEN_SHARE:
        return None
    planes = _planes(at[:, :2] - middle, xy, over_m)
    shares = [_share_on(plane, layers.column, xy, over_m, len(at)) for plane in planes]
    if not shares or max(shares) < max(LEANING_SHARE, MORE * even):
        return None
    plane = planes[int(np.argmax(shares))]
    on = np.abs(xy @ plane[:2] + plane[2] - over_m) < SAME_M
    used = on if np.ptp((at[:, :2] - middle) @ _across(at)) > _STRAIGHT_M else None
    if used is not None:
        plane = np.linalg.lstsq(np.column_stack([xy[on], np.ones(on.sum())]), over_m[on], rcond=None)[0]
    height_m = (at[:, :2] - middle) @ plane[:2] + plane[2]
    if np.ptp(height_m) < MIN_RISE_M:
        return None
    ends = at[[int(np.argmin(height_m)), int(np.argmax(height_m))]]
    places = marked(ends, origin)
    numbers = {
        "poses": under.poses,
        "lean_deg": float(np.degrees(np.arctan(np.hypot(*plane[:2])))),
        "direction_deg": float(np.degrees(np.arctan2(plane[1], plane[0]))),
        "lowest_m": float(height_m.min()),
        "highest_m": float(height_m.max()),
        "leaning_share": max(shares),
        "even_share": even,
    }
    return TRAJECTORY_LEANS.found(numbers, near=in_words(places[:1]), to=in_words(places[1:])).at(places)


def _across(at: NDArray[np.float64]) -> NDArray[np.float64]:
    """Level direction (2,) in which the way is narrowest."""
    direction: NDArray[np.float64] = np.linalg.svd(at[:, :2] - at[:, :2].mean(axis=0), full_matrices=False)[
        2
    ][1]
    return direction


def _share_at_one_height(column: NDArray[np.intp], over_m: NDArray[np.float64], count: int) -> float:
    """Largest share of the poses that have a layer at about one height."""
    most = 0
    for low_m in np.arange(over_m.min() - SAME_M, over_m.max(), SAME_M / 3):
        near = (over_m >= low_m) & (over_m < low_m + 2 * SAME_M)
        most = max(most, len(np.unique(column[near])))
    return most / count


def _share_on(
    plane: NDArray[np.float64],
    column: NDArray[np.intp],
    xy: NDArray[np.float64],
    over_m: NDArray[np.float64],
    count: int,
) -> float:
    near = np.abs(xy @ plane[:2] + plane[2] - over_m) < SAME_M
    return np.count_nonzero(np.bincount(column[near], minlength=count)) / count


def _planes(
    way: NDArray[np.float64], xy: NDArray[np.float64], over_m: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Planes (p, 3) through layers by chance: rises along x and y, and the height in the middle."""
    rows = np.random.default_rng(_SEED).integers(0, len(xy), (_TRIED, 3))
    _, width, axes = np.linalg.svd(way, full_matrices=False)
    if width[1] / np.sqrt(len(way)) < _STRAIGHT_M:
        along_m = xy @ axes[0]
        first, second = rows[:, 0], rows[:, 1]
        apart_m = along_m[first] - along_m[second]
        far = np.abs(apart_m) > 0.3 * np.ptp(way @ axes[0])
        rise = (over_m[first] - over_m[second])[far] / apart_m[far]
        planes = np.column_stack([rise[:, None] * axes[0], over_m[first][far] - rise * along_m[first][far]])
    else:
        corners = np.concatenate([xy[rows], np.ones((*rows.shape, 1))], axis=2)
        size = np.abs(np.linalg.det(corners))
        large = size > max(float(np.median(size)), 1e-6)
        planes = np.linalg.solve(corners[large], over_m[rows[large]][..., None])[..., 0]
    gentle: NDArray[np.float64] = planes[
        np.hypot(planes[:, 0], planes[:, 1]) < np.tan(np.radians(MOST_LEAN_DEG))
    ]
    return gentle
