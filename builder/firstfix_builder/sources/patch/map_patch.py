"""Patch of a map: the points that confirmed changes add to its cloud and remove from it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from firstfix.engine.changes.cells import cells_of, keys_of
from firstfix.engine.changes.sighting import Comparison
from firstfix.engine.index import MapIndex
from firstfix.errors import CorruptVersion
from firstfix.transform import Matrix, inverse, transform_points

from ...mesh.clean_cloud import voxel_means
from ...mesh.intensity import Intensity
from .confirm import Change
from .observation import Seen

NEAREST_M = 0.2  # from a point of the cloud to the mapped point whose state it shares
PASSES_A_HIT = 3  # so many times as often seen through as met
TOGETHER_M = 0.2  # returns of two robots so near to each other are of one thing
SAME_POINT_M = 0.002
_AROUND = np.array(list(np.ndindex(3, 3, 3))) - 1


@dataclass(frozen=True)
class MapPatch:
    """Points to add to a cloud and to remove from it, in its levelled frame.

    Attributes:
        added: (n, 3) float32 metres.
        removed: (k, 3) float32 points of the cloud that go.
    """

    added: NDArray[np.float32] = field(default_factory=lambda: np.empty((0, 3), np.float32))
    removed: NDArray[np.float32] = field(default_factory=lambda: np.empty((0, 3), np.float32))

    def lay(self, cloud: NDArray[np.float64]) -> NDArray[np.float64]:
        """The (m, 3) cloud with this patch: the points that it keeps, then those that it adds."""
        return np.concatenate([cloud[self.keeps(cloud)], self.added.astype(np.float64)])

    def keeps(self, cloud: NDArray[np.float64]) -> NDArray[np.bool_]:
        """(n,) which points of the cloud stay."""
        return ~_is_among(cloud, self.removed)

    def shade(self, cloud: NDArray[np.float64], intensity: Intensity) -> Intensity:
        """The (m,) intensity of ``lay(cloud)``.

        What robots have seen has none that could be compared with the map's, so that added points are of the
        map's middle brightness.
        """
        kept = intensity.values[self.keeps(cloud)]
        added = np.full(len(self.added), round(float(np.median(intensity.values))), np.uint8)
        return replace(intensity, values=np.concatenate([kept, added]))

    def then(self, later: MapPatch) -> MapPatch:
        """The patch that does the work of both, this one first."""
        kept = self.added[~_is_among(self.added, later.removed)]
        return MapPatch(np.concatenate([kept, later.added]), np.concatenate([self.removed, later.removed]))

    def save(self, path: Path) -> None:
        """Write it to a file."""
        np.savez(path, added=self.added, removed=self.removed)

    @classmethod
    def load(cls, path: Path) -> MapPatch:
        """Read what ``save`` wrote.

        Raises:
            CorruptVersion: the file has another form.
        """
        try:
            with np.load(path) as file:
                found = cls(file["added"], file["removed"])
        except (OSError, ValueError, KeyError, EOFError) as error:
            raise CorruptVersion(f"{path.name}: {error}") from None
        for part in (found.added, found.removed):
            if part.dtype != np.float32 or part.shape[1:] != (3,) or not np.isfinite(part).all():
                raise CorruptVersion(f"{path.name}: it has no points of three finite float32 numbers")
        return found


def patch_of(
    changes: Sequence[Change],
    seen: Sequence[Seen],
    index: MapIndex,
    cloud: NDArray[np.float64],
    *,
    robots: int,
    voxel_m: float,
) -> MapPatch:
    """The patch that lays changes into a cloud.

    Points are added where robots have met something new, and removed where they have seen through.

    Args:
        index: of the version that answered.
        cloud: (n, 3) levelled frame.
        robots: number of robots that must agree about each point.
        voxel_m: between added points.
    """
    T_map_level = index.T_map_level
    added, removed = [], np.zeros(len(cloud), np.bool_)
    keys = keys_of(cells_of(transform_points(T_map_level, cloud)))
    for change in changes:
        around = np.unique(keys_of((change.cells[:, None] + _AROUND).reshape(-1, 3)))
        since = [one for one in seen if one.observation.time_s >= change.since_s]
        if change.kind == "new":
            added.append(_met_points(since, index, around, robots))
        else:
            rows = np.flatnonzero(np.isin(keys, around))
            removed[rows] |= _left(cloud[rows], since, index, robots)
    points = np.concatenate(added) if added else np.empty((0, 3))
    if len(points):
        points = voxel_means(points, voxel_m)
    return MapPatch(points.astype(np.float32), cloud[removed].astype(np.float32))


def _met_points(
    seen: Sequence[Seen], index: MapIndex, around: NDArray[np.int64], robots: int
) -> NDArray[np.float64]:
    """(n, 3) returns in these cells that the map does not explain, near which several robots have some."""
    T_level_map = inverse(index.T_map_level)
    points, robot = [np.empty((0, 3))], [np.empty(0, np.str_)]
    for one, compared, T_map_sensor in _comparisons(seen, index, around):
        at = transform_points(T_map_sensor, compared.returns[compared.new])
        at = at[np.isin(keys_of(cells_of(at)), around)]
        points.append(transform_points(T_level_map, at))
        robot.append(np.full(len(at), one.observation.robot))
    every, who = np.concatenate(points), np.concatenate(robot)
    near = np.zeros(len(every), np.int64)
    for name in np.unique(who):
        away_m, _ = cKDTree(every[who == name]).query(every, distance_upper_bound=TOGETHER_M)
        near += np.isfinite(away_m)
    return every[near >= robots]


def _left(
    points: NDArray[np.float64], seen: Sequence[Seen], index: MapIndex, robots: int
) -> NDArray[np.bool_]:
    """(n,) which points of the cloud several robots have seen through, and clearly fewer have met."""
    T_level_map = inverse(index.T_map_level)
    around = np.unique(keys_of(cells_of(transform_points(index.T_map_level, points))))
    passed, met = np.zeros(len(points), np.int64), np.zeros(len(points), np.int64)
    by: dict[str, NDArray[np.bool_]] = {}
    for one, compared, T_map_sensor in _comparisons(seen, index, around):
        state = np.where(compared.gone, 1, np.where(compared.met, 2, 0))
        if not len(state):
            continue
        mapped = transform_points(T_level_map @ T_map_sensor, compared.mapped)
        away_m, row = cKDTree(mapped).query(points, distance_upper_bound=NEAREST_M)
        told = np.where(np.isfinite(away_m), np.append(state, 0)[row], 0)
        passed += told == 1
        met += told == 2
        of_robot = by.setdefault(one.observation.robot, np.zeros(len(points), np.bool_))
        of_robot |= told == 1
    count = np.sum(list(by.values()), axis=0) if by else np.zeros(len(points), np.int64)
    left: NDArray[np.bool_] = (count >= robots) & (passed >= PASSES_A_HIT * met)
    return left


def _comparisons(
    seen: Sequence[Seen], index: MapIndex, around: NDArray[np.int64]
) -> Iterator[tuple[Seen, Comparison, Matrix]]:
    """The observations that say something about these cells, compared with the map."""
    for one in seen:
        told = (one.sighting.contradicted, one.sighting.confirmed, one.sighting.unexplained)
        if any(np.isin(keys, around).any() for keys in told):
            yield one, one.observation.compared(index), one.observation.T_map_sensor


def _is_among(points: NDArray[np.floating], others: NDArray[np.floating]) -> NDArray[np.bool_]:
    """(n,) which points are among the others."""
    if not len(points) or not len(others):
        return np.zeros(len(points), np.bool_)
    away_m, _ = cKDTree(others).query(points, distance_upper_bound=SAME_POINT_M)
    return np.isfinite(away_m)
