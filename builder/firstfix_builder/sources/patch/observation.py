"""Observations: scans of localized queries, of which replays and scans at a wrong pose are left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from firstfix.bit_exact.sample import rows_by_chance
from firstfix.engine.changes.block import REACH_M
from firstfix.engine.changes.sighting import Comparison, Sighting, sighting_in
from firstfix.engine.index import MapIndex
from firstfix.scan.compact import CompactScan
from firstfix.scan.scan import Scan
from firstfix.transform import Matrix, inverse, transform_points

UPRIGHT_NZ = 0.5
MIN_UPRIGHT = 100  # returns that are not on a floor: with fewer, nothing says that the pose is right
EXPLAINED, EXPLAINED_M = 0.8, 0.15  # of these, the share that lies so near to a mapped wall or thing
# A scan that is told again, at the same pose: most of its points are there again. Those of a second scan are
# not, by the sensor's noise.
SAME_POSE_M, SAME_POSE_RAD = 0.05, 0.02
SAME_POINT_M = 0.005
SAME_POINTS = 0.5
_COMPARED = 500


@dataclass(frozen=True)
class Observation:
    """The scan of one localized query.

    Attributes:
        robot: pseudonym of the credential that asked; never empty.
        time_s: of its answer by the service's clock, seconds since 1970.
        scan: its points.
        T_map_sensor: (4, 4) in the map's own frame.
        twist: (6,) motion during the scan, or None.
    """

    robot: str
    time_s: float
    scan: Scan | CompactScan
    T_map_sensor: Matrix
    twist: NDArray[np.float64] | None = None

    def compared(self, index: MapIndex) -> Comparison:
        """The scan against the map, point by point."""
        return Comparison.of(index, self.scan, self.T_map_sensor, self.twist)


@dataclass(frozen=True)
class Seen:
    """An observation that counts, and what it says about the cells of the map."""

    observation: Observation
    sighting: Sighting


@dataclass(frozen=True)
class LeftOut:
    """Numbers of observations that do not count.

    Attributes:
        replayed: scans that were told before.
        doubtful: scans that do not fit the unchanged map around their pose.
    """

    replayed: int
    doubtful: int


def seen_by(index: MapIndex, observations: Sequence[Observation]) -> tuple[list[Seen], LeftOut]:
    """The observations that count, oldest first.

    Args:
        index: of the version that answered them.
    """
    first = without_replays(sorted(observations, key=lambda one: (one.time_s, one.robot)))
    found = []
    for one in first:
        compared = one.compared(index)
        if fits_around(index, compared.returns, one.T_map_sensor):
            found.append(Seen(one, sighting_in(compared, one.T_map_sensor)))
    return found, LeftOut(len(observations) - len(first), len(first) - len(found))


def fits_around(index: MapIndex, returns: NDArray[np.float32], T_map_sensor: Matrix) -> bool:
    """Whether the unchanged map explains most of a scan: then its pose is right.

    Floors and ceilings do not count. They fit at every wrong pose, too.

    Args:
        returns: (n, 3) sensor frame.
    """
    grid = index.surface.fine
    near = returns[np.linalg.norm(returns, axis=1) < REACH_M]
    at = transform_points(inverse(index.T_map_level) @ T_map_sensor, near) - grid.corner
    row = grid.nearest(np.ascontiguousarray(at, np.float32))
    plane = grid.planes[row]
    upright = (row < 0) | (np.abs(plane[:, 2]) < UPRIGHT_NZ)
    away_m = np.abs(np.einsum("ij,ij->i", plane[:, :3], at) - plane[:, 3])
    explained = (row >= 0) & upright & (away_m <= EXPLAINED_M)
    return bool(upright.sum() >= MIN_UPRIGHT and explained.sum() >= EXPLAINED * upright.sum())


def without_replays(observations: Sequence[Observation]) -> list[Observation]:
    """The observations without those whose scan was told before, by whichever robot.

    Args:
        observations: the oldest first.
    """
    kept: list[Observation] = []
    T = np.empty((len(observations), 4, 4))
    trees: list[cKDTree] = []
    for one in observations:
        n = len(kept)
        away_m = np.linalg.norm(T[:n, :3, 3] - one.T_map_sensor[:3, 3], axis=1)
        turned = np.linalg.norm(T[:n, :3, :3] - one.T_map_sensor[:3, :3], axis=(1, 2)) / np.sqrt(2)
        near = (away_m < SAME_POSE_M) & (turned < SAME_POSE_RAD)
        points = one.scan.points
        if any(_has_most_of(trees[row], points) for row in np.flatnonzero(near)):
            continue
        T[n] = one.T_map_sensor
        trees.append(cKDTree(points))
        kept.append(one)
    return kept


def _has_most_of(tree: cKDTree, points: NDArray[np.float32]) -> bool:
    """Whether most of (n, 3) points are among those of a tree."""
    if not len(points) or not tree.n:
        return False
    some = points[rows_by_chance(len(points), _COMPARED)]
    away_m, _ = tree.query(some, distance_upper_bound=SAME_POINT_M)
    return bool(np.isfinite(away_m).mean() > SAME_POINTS)
