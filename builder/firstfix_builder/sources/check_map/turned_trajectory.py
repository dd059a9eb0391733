"""A trajectory that is turned or mirrored against its map, by how well it fits in other directions.

A mapping run sees what is near it, and sees it densely: its map's points lie near the trajectory, the denser
the nearer, and no pose lies in a wall. So a right trajectory fits better than its copies, turned and mirrored
about its middle or the map's origin. One whose copy fits better is not of this map's frame. In an open hall
that is seen whole from everywhere, no copy fits better, and it does no harm there.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from firstfix.bit_exact.sample import rows_by_chance
from firstfix.findings.finding import Finding
from firstfix.findings.map_kinds import TRAJECTORY_MAYBE_TURNED, TRAJECTORY_TURNED
from firstfix.transform import rotation_z

# Lead of the best copy. Of eleven right maps 0.02 at most, 0.10 with the poses of a half or a third of
# the run and 0.17 with those of one of three sessions. Of most
# turned ones 0.2 and more, by 90 degrees often over 0.5.
LEAD, SURE_LEAD = 0.12, 0.5
SURE_DENSER = 0.05  # better correlation of density with nearness, to be sure
STEP_DEG = 30
TOUCHING_M = 0.3
OWN_POINTS = 0.4  # more poses with points so near: the map has the robot itself, and touching says nothing
_MIN_POSES, _SAMPLED_POSES = 5, 200
_SAMPLED_POINTS, _COMPARED_POINTS = 300_000, 4_000
_NEIGHBOURS = 8
_NEAR_M = 1.0  # points nearer than this are near, however near they are


@dataclass(frozen=True)
class _Fit:
    """How well positions of a sensor fit a map.

    Attributes:
        away: mean logarithm of the distance between the map's points and the nearest position.
        denser: rank correlation of the points' density with their nearness, -1..1.
        touching: share of the positions with a surface within TOUCHING_M.
    """

    away: float
    denser: float
    touching: float

    def lead_over(self, other: _Fit) -> float:
        """By how much it fits better; 0 where the two measures do not agree."""
        if self.denser <= other.denser or self.away >= other.away:
            return 0.0
        less_touching = other.touching - self.touching
        return (
            other.away
            - self.away
            + (min(less_touching, 0.0) if other.touching > OWN_POINTS else less_touching)
        )


class _Samples:
    """Points of a map by which trajectories are judged."""

    def __init__(self, points: NDArray[np.float64]) -> None:
        sampled = points[rows_by_chance(len(points), _SAMPLED_POINTS)]
        self._tree = cKDTree(sampled)
        self._points = sampled[rows_by_chance(len(sampled), _COMPARED_POINTS)]
        self._density = _ranks(-self._tree.query(self._points, _NEIGHBOURS)[0][:, -1])

    def fit(self, at: NDArray[np.float64]) -> _Fit:
        away_m = cKDTree(at).query(self._points)[0]
        denser = float(np.corrcoef(self._density, _ranks(-away_m))[0, 1])
        near_m = self._tree.query(at, distance_upper_bound=TOUCHING_M)[0]
        return _Fit(float(np.log(away_m + _NEAR_M).mean()), denser, float(np.isfinite(near_m).mean()))


def check_turned(
    points: NDArray[np.float64], poses: NDArray[np.float64], origin: NDArray[np.float64]
) -> Finding | None:
    """Finding of (m, 4, 4) poses that fit a map with (n, 3) points better if they are turned or mirrored.

    Args:
        origin: (3,) of the map's file, in the frame of the points and the poses.
    """
    at = poses[rows_by_chance(len(poses), _SAMPLED_POSES), :3, 3]
    if len(at) < _MIN_POSES or len(points) <= _NEIGHBOURS:
        return None
    samples = _Samples(points)
    given = samples.fit(at)
    lead, best, turn_deg, is_mirrored = max(
        (
            (fit.lead_over(given), fit, turn_deg, is_mirrored)
            for copy, turn_deg, is_mirrored in _copies(at, origin)
            for fit in [samples.fit(copy)]
        ),
        key=lambda one: one[0],
    )
    if lead < LEAD:
        return None
    is_sure = lead >= SURE_LEAD and best.denser - given.denser >= SURE_DENSER
    numbers = {
        "poses": len(poses),
        "turn_deg": turn_deg,
        "lead": lead,
        "nearer_share": 1 - float(np.exp(best.away - given.away)),
        "touching_share": given.touching,
        "copy_touching_share": best.touching,
    }
    kind = TRAJECTORY_TURNED if is_sure else TRAJECTORY_MAYBE_TURNED
    return kind.found(numbers, mirrored="mirrored and " if is_mirrored else "")


def _copies(
    at: NDArray[np.float64], origin: NDArray[np.float64]
) -> Iterator[tuple[NDArray[np.float64], float, bool]]:
    """The (m, 3) positions turned, and mirrored and turned, about their middle and about the map's origin."""
    for about in (at.mean(axis=0), origin):
        for is_mirrored in (False, True):
            mirror = np.diag([1.0, -1.0 if is_mirrored else 1.0, 1.0])
            for turn_deg in range(0, 360, STEP_DEG):
                if turn_deg or is_mirrored:
                    R = rotation_z(np.radians(turn_deg)) @ mirror
                    yield (at - about) @ R.T + about, float(turn_deg), is_mirrored


def _ranks(values: NDArray[np.float64]) -> NDArray[np.float64]:
    ranks = np.empty(len(values))
    ranks[np.argsort(values, kind="stable")] = np.arange(len(values))
    return ranks
