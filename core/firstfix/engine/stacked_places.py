"""Places right above and below a pose: storeys stand on each other, and often by one plan.

Descriptors of two such rooms differ by what stands in them, so the build may not know them as aliases, and
the search may find the one without the other (docs/method.md section 7.1).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .. import native
from ..native import STACKED_WITHIN_M, STOREY_M
from ..transform import Matrix
from .candidates import Candidates
from .index import MapIndex

_MOST = 4  # floors, nearest first: of a tower


def stacked_places(index: MapIndex, T_level_sensor: Matrix) -> Candidates:
    """The pose moved to the other floors on which the map has templates near by, nearest floor first.

    Args:
        T_level_sensor: (4, 4) the pose.

    Returns:
        Candidates of score 1; none where there is one floor.
    """
    templates, at_m = index.cascade.templates, T_level_sensor[:3, 3]
    rows = index.cascade.tiles.near_on_level(templates.position_m, at_m, STACKED_WITHIN_M)
    if not len(rows):
        return Candidates.merged([])
    position_m = np.array(templates.position_m[rows], np.float64)
    floor_m = position_m[:, 2] - templates.height_m[rows]
    own_m = floor_m[np.argmin(np.linalg.norm(position_m - at_m, axis=1))]
    away_m = np.abs(floor_m - own_m)
    found: list[int] = []
    for number in np.argsort(np.linalg.norm(position_m[:, :2] - at_m[:2], axis=1), kind="stable").tolist():
        others_m = floor_m[found]
        if away_m[number] > STOREY_M and (np.abs(others_m - floor_m[number]) > STOREY_M).all():
            found.append(number)
    found = sorted(found, key=lambda number: away_m[number])[:_MOST]
    T = np.repeat(T_level_sensor[None], len(found), axis=0)
    T[:, 2, 3] += floor_m[found] - own_m
    return Candidates(rows[found], T, np.ones(len(found)))


def is_stacked(at_m: NDArray[np.float64], others_m: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(k,) which of (k, 3) positions are above or below one, (3,)."""
    return native.is_stacked(at_m, others_m)
