"""Further hypotheses of up for a scan, in NumPy: ``native.other_ups`` is held against it."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from firstfix.scan.levelling import directions_about_z, estimate_up_near, refined_up, votes
from firstfix.scan.reduction import at_most

_MAIN_AXES = 3  # the floor's normal and those of two directions of walls
_MIN_VOTES = 0.5  # of the best axis's votes: an axis with fewer comes from clutter
_AXIS_COSINE = np.cos(np.radians(25.0))  # nearer directions are one axis
_IN_PLANE_COSINE = np.cos(np.radians(65.0))  # with the normal of a plane, of axes in it
_NEW_DEG = 10.0  # nearer up directions lead to the same poses
_NEW_BY_GRAVITY_DEG = 1.5  # the surfaces may correct a shaken IMU by little more than this
_VOTERS = 1000


def other_ups(
    normals: NDArray[np.floating], known: NDArray[np.float64], gravity: NDArray[np.float64] | None
) -> list[NDArray[np.float64]]:
    """Unit up vectors to try after another one failed.

    Without gravity: the opposite of the failed one, and both senses of each main axis. With gravity: the
    vector against it, and the one that the surfaces suggest near that.

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
    """Main axes of (n, 3) surface normals: unit vectors of any sign, up to three by votes.

    Most of the normals are parallel to an axis or at right angles to it. Where floor and ceiling are rough,
    every level direction may have more votes than up has: more normals are about at right angles to it than
    are about parallel to up. So where all axes lie in one plane, its normal is an axis too.
    """
    directions = directions_about_z(90.0)
    normals = at_most(normals, _VOTERS)
    won = votes(normals, directions)
    least = _MIN_VOTES * won.max()
    axes: list[NDArray[np.float64]] = []
    while len(axes) < _MAIN_AXES and won.max() >= least:
        voted = directions[int(np.argmax(won))]
        axes.append(refined_up(normals, voted))
        won[np.abs(directions @ voted) > _AXIS_COSINE] = -1
    if len(axes) == _MAIN_AXES:
        across = np.cross(axes[0], axes[1])
        length = np.linalg.norm(across)
        if abs(across @ axes[2]) < _IN_PLANE_COSINE * length:
            axes.append(refined_up(normals, across / length))
    return axes


def _new_among(
    ups: Iterable[NDArray[np.float64]], known: NDArray[np.float64], apart_deg: float
) -> list[NDArray[np.float64]]:
    """The up vectors without those near the known one or near an earlier one."""
    new, nearly = [known], np.cos(np.radians(apart_deg))
    for up in ups:
        if all(up @ other < nearly for other in new):
            new.append(up)
    return new[1:]
