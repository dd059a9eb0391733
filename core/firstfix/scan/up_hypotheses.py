"""Other directions that may be up in a scan: its sensor may hang head down, or sit on its side.

``levelling`` looks within 35 degrees of where up is expected. Floors, ceilings and walls show the main axes
of a place in any orientation of the sensor. They do not show which of the axes is up, nor which way along
it: the map tells that (docs/method.md section 6).
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from .levelling import directions_about_z, estimate_up_near, refined_up, votes
from .voxel_filter import at_most

_MAIN_AXES = 3  # a floor and two directions of walls
_LEAST_VOTES = 0.5  # of the best axis's: fewer are clutter's
_AXIS_COSINE = np.cos(np.radians(25.0))  # nearer directions are one axis
_NEW_DEG = 10.0  # nearer ups lead to the same places
_NEW_BY_GRAVITY_DEG = 1.5  # of an IMU that is shaken, the surfaces may know better by less
_VOTERS = 1000


def other_ups(
    normals: NDArray[np.floating], known: NDArray[np.float64], gravity: NDArray[np.float64] | None
) -> list[NDArray[np.float64]]:
    """Unit up vectors that may be true where one that was tried is not.

    Without gravity: the opposite of the one that was tried, and both ways along the main axes. With it:
    against gravity, and what the surfaces say near that.

    Args:
        normals: (n, 3) unit surface normals, any sign.
        known: (3,) unit up vector that was tried.
        gravity: (3,) of any length but zero, or None: not known.
    """
    if gravity is None:
        axes = main_axes(normals)
        return _new_among([-known, *axes, *(-axis for axis in axes)], known, _NEW_DEG)
    measured = -gravity / np.linalg.norm(gravity)
    return _new_among([measured, estimate_up_near(normals, measured)], known, _NEW_BY_GRAVITY_DEG)


def main_axes(normals: NDArray[np.floating]) -> list[NDArray[np.float64]]:
    """Up to three unit vectors, any sign, to which most of (n, 3) surface normals are parallel or at right
    angles."""
    directions = directions_about_z(90.0)
    normals = at_most(normals, _VOTERS)
    won = votes(normals, directions)
    least = _LEAST_VOTES * won.max()
    axes: list[NDArray[np.float64]] = []
    while len(axes) < _MAIN_AXES and won.max() >= least:
        voted = directions[int(np.argmax(won))]
        axes.append(refined_up(normals, voted))
        won[np.abs(directions @ voted) > _AXIS_COSINE] = -1
    return axes


def _new_among(
    ups: Iterable[NDArray[np.float64]], known: NDArray[np.float64], apart_deg: float
) -> list[NDArray[np.float64]]:
    """The first of those that are nearly the same, without those that are nearly the known one."""
    new, nearly = [known], np.cos(np.radians(apart_deg))
    for up in ups:
        if all(up @ other < nearly for other in new):
            new.append(up)
    return new[1:]
