"""Information that comes from surfaces which truly face a direction (docs/method.md section 7)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

# Sine. Normals of recorded maps scatter by 2 to 5 degrees. A surface that faces a direction by over 17
# degrees is no wall along it.
_FACES = 0.3


def faced_information(
    information: NDArray[np.float64],
    arms: NDArray[np.floating],
    normals: NDArray[np.floating],
    information_of: Callable[[NDArray[np.intp]], NDArray[np.float64]],
) -> NDArray[np.float64]:
    """Information (6, 6) less what walls seem to tell of shifts along them, and of turns about their normal.

    Normals scatter, so the walls of a bare corridor seem to tell of the shift along it, and the more points
    there are the surer. What a principal direction of shifts, or of turns, has is cut to the share that comes
    from the points which face it.

    Args:
        information: (6, 6) over rotation then translation.
        arms: (n, 3) scan points from the sensor, along the level axes.
        normals: (n, 3) of the map's surface at each, 0 where none is near.
        information_of: that of the given rows alone, at the same pose.
    """
    whole = information_of(np.arange(len(arms)))
    root = np.zeros((6, 6))
    for part, is_turn in ((slice(0, 3), True), (slice(3, 6), False)):
        for axis in np.linalg.eigh(information[part, part])[1].T:
            way = np.cross(axis, arms) if is_turn else axis[None]  # in which the points would move
            told = (normals * way).sum(axis=1)
            facing = np.flatnonzero(np.abs(told) > _FACES * np.linalg.norm(way, axis=1))
            of_all = axis @ whole[part, part] @ axis
            of_facing = axis @ information_of(facing)[part, part] @ axis
            share = min(1.0, of_facing / of_all) if of_all > 0 else 0.0
            root[part, part] += np.sqrt(share) * np.outer(axis, axis)
    return root @ information @ root
