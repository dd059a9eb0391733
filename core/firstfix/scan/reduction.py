"""Thinning of a cloud: by range, evenly, or to one point a voxel.

Every result is defined to the last bit, so that a robot's client in another language keeps the same points
(clients/protocol/on-the-robot.md).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ..bit_exact.accelerated import accelerated
from ..bit_exact.atan2 import atan2_turns
from ..bit_exact.sample import hashed, rows_by_chance

_Float = TypeVar("_Float", bound=np.floating)

BORDER_M = 0.0005  # scanners and files round to whole millimetres: no point of theirs lies on such a border
_STEPS_A_METRE = 2.0**20
_STEPS_A_SECOND = 2.0**20
_PRIMES = np.array([[19_349_663], [83_492_791], [73_856_093]], np.uint32)


@accelerated
def within_range(points: NDArray[np.float32], min_range_m: float, max_range_m: float) -> NDArray[np.float32]:
    """The points, of (n, 3), whose distance from the origin lies between two limits, in float32."""
    return points[is_within_range(points, min_range_m, max_range_m)]


def is_within_range(points: NDArray[np.float32], min_range_m: float, max_range_m: float) -> NDArray[np.bool_]:
    """For each of the points whether ``within_range`` keeps it: (n,)."""
    x, y, z = points.T
    range2 = x * x + y * y + z * z  # not einsum, whose order of steps depends on the processor
    least, most = np.float32(min_range_m * min_range_m), np.float32(max_range_m * max_range_m)
    return (range2 > least) & (range2 < most)


def at_most(points: NDArray[_Float], count: int) -> NDArray[_Float]:
    """At most ``count`` of (n, 3) points, in their order (``rows_by_chance``)."""
    return points if len(points) <= count else chosen_by_chance(points, count)


@accelerated
def chosen_by_chance(points: NDArray[_Float], at_most: int) -> NDArray[_Float]:
    """The rows of (n, 3) points that ``rows_by_chance`` chooses."""
    return points.take(rows_by_chance(len(points), at_most), axis=0)


@accelerated
def rows_by_voxel_hash(points: NDArray[np.floating], voxel_m: float, at_most: int) -> NDArray[np.int64]:
    """Ascending rows of the points whose voxels have the lowest hashes; within a voxel, the first rows.

    Each point is taken for its own place. So a point more or less changes one point of the sample, while it
    changes half of those that ``rows_by_chance`` takes of points in the order of their places.

    Args:
        points: (n, 3) finite metres.
        voxel_m: size of the voxels, which have a border at BORDER_M.
        at_most: number of rows. A shorter list gives all its rows.
    """
    count = len(points)
    if count <= at_most:
        return np.arange(count)
    cells = np.floor((points.T.astype(np.float64) - BORDER_M) / voxel_m).astype(np.int64).astype(np.uint32)
    order = hashed(np.bitwise_xor.reduce(cells * _PRIMES)).astype(np.uint64) << np.uint64(32)
    order |= np.arange(count, dtype=np.uint64)
    return np.flatnonzero(order < np.partition(order, at_most)[at_most])


@accelerated
def first_in_voxel(points: NDArray[np.floating], voxel_m: float) -> NDArray[np.int64]:
    """Rows, ascending, of the first point in every occupied voxel.

    Measured points are kept as they are: a mean would round the edges that registration needs.

    Args:
        points: (n, 3) finite metres; each axis may span at most 2**21 voxels.
    """
    if len(points) == 0:
        return np.empty(0, np.int64)
    cells = np.floor(np.asarray(points, np.float64) / voxel_m).astype(np.int64)
    cells -= cells.min(axis=0)
    keys = (cells[:, 2] << 42) | (cells[:, 1] << 21) | cells[:, 0]
    _, first = np.unique(keys, return_index=True)
    return np.sort(first).astype(np.int64)


@accelerated
def voxel_means(points: NDArray[np.floating], voxel_m: float, border_m: float = 0.0) -> NDArray[np.float64]:
    """Mean (m, 3) of the points in every occupied voxel, ordered by the voxels' z, then y, then x.

    Coordinates are rounded to 2 ** -20 m, about a micrometre: their sums are then exact in any order.

    Args:
        points: (n, 3) finite metres.
        border_m: coordinate, on every axis, of a border between voxels.
    """
    if len(points) == 0:
        return np.empty((0, 3))
    order, start, count = _by_voxel(points, voxel_m, border_m)
    steps = np.rint(np.asarray(points, np.float64) * _STEPS_A_METRE)
    return np.add.reduceat(steps[order], start, axis=0) / (count * _STEPS_A_METRE)[:, None]


@accelerated
def voxel_mean_times(
    points: NDArray[np.floating], time_s: NDArray[np.float32], voxel_m: float, border_m: float = 0.0
) -> NDArray[np.float64]:
    """Mean time (m,) of the points in every occupied voxel, in the order of ``voxel_means``.

    Times are rounded to 2 ** -20 s.

    Args:
        points: (n, 3) finite metres.
        time_s: (n,) finite seconds.
        border_m: coordinate, on every axis, of a border between voxels.
    """
    if len(points) == 0:
        return np.empty(0)
    order, start, count = _by_voxel(points, voxel_m, border_m)
    steps = np.rint(time_s.astype(np.float64) * _STEPS_A_SECOND)
    return np.add.reduceat(steps[order], start) / (count * _STEPS_A_SECOND)


def _by_voxel(
    points: NDArray[np.floating], voxel_m: float, border_m: float
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Rows of the points voxel by voxel, and for each voxel where its rows begin and how many there are."""
    cells = np.floor((np.asarray(points, np.float64) - border_m) / voxel_m).astype(np.int64)
    cells -= cells.min(axis=0)
    size = cells.max(axis=0) + 1
    keys = (cells[:, 2] * size[1] + cells[:, 1]) * size[0] + cells[:, 0]
    order = np.argsort(keys, kind="stable")
    start = np.flatnonzero(np.diff(keys[order], prepend=-1))
    return order, start, np.diff(start, append=len(points))


@dataclass(frozen=True)
class TimedPoints:
    """Points, and their times where these are known.

    Attributes:
        points: (n, 3) metres, float32; means of voxels float64.
        time_s: (n,) float32 seconds from the scan's stamp, or None.
    """

    points: NDArray[np.floating]
    time_s: NDArray[np.float32] | None

    def at(self, rows: NDArray[np.integer] | NDArray[np.bool_]) -> TimedPoints:
        """The given rows."""
        if rows.dtype == np.bool_:
            rows = np.flatnonzero(rows)
        # of some thousand rows, take copies a point at once, indexing number by number
        return TimedPoints(
            self.points.take(rows, axis=0), None if self.time_s is None else self.time_s.take(rows)
        )

    def within_range(self, min_range_m: float, max_range_m: float) -> TimedPoints:
        """Point whose distance from the sensor lies between two limits (``reduction.within_range``)."""
        if self.time_s is None:
            return TimedPoints(within_range(self.points, min_range_m, max_range_m), None)
        return self.at(is_within_range(self.points, min_range_m, max_range_m))

    def at_most(self, count: int) -> TimedPoints:
        """At most ``count`` of the points, in their order (``rows_by_chance``)."""
        if self.time_s is None:
            return TimedPoints(at_most(self.points, count), None)
        return self if len(self.points) <= count else self.at(rows_by_chance(len(self.points), count))

    def voxel_means(self, voxel_m: float) -> TimedPoints:
        """Mean point and mean time of every voxel. The voxels have a border at BORDER_M."""
        means = voxel_means(self.points, voxel_m, BORDER_M)
        if self.time_s is None:
            return TimedPoints(means, None)
        times = voxel_mean_times(self.points, self.time_s, voxel_m, BORDER_M)
        return TimedPoints(means, times.astype(np.float32))

    def by_voxel_hash(self, voxel_m: float, at_most: int) -> TimedPoints:
        """An even part of the points, float32 (``rows_by_voxel_hash``)."""
        chosen = self.at(rows_by_voxel_hash(self.points, voxel_m, at_most))
        return TimedPoints(chosen.points.astype(np.float32), chosen.time_s)


CELL_DEG = 2.0
COLUMNS = round(360 / CELL_DEG)
ROWS = round(180 / CELL_DEG)
NEAREST_M = 0.3
ENOUGH = 7  # of a cell and its eight neighbours; fewer lie at the edge of the field of view or beside holes

_RADIANS_A_CELL = 2 * np.pi / COLUMNS


@dataclass(frozen=True)
class RangeView:
    """Ranges of one scan by direction, made once for all the poses at which it is checked.

    Attributes:
        returned: (cells,) whether there are returns in that direction and around it, in ENOUGH cells. Beside
            a hole nobody knows what a ray would have met. In a scan that is mostly holes: in that direction.
        least: (cells,) nearest range in and around the direction, metres.
    """

    returned: NDArray[np.bool_]
    least: NDArray[np.float32]

    @classmethod
    def of(cls, points: NDArray[np.float32]) -> RangeView:
        """Range view of points.

        Args:
            points: (n, 3) some thousand returns, sensor frame.
        """
        return cls.of_nearest(nearest_by_direction(points))

    @classmethod
    def of_nearest(cls, nearest: NDArray[np.float32]) -> RangeView:
        """Range view of (cells,) nearest ranges, infinite in directions without a return."""
        returned, least = range_view(nearest)
        return cls(returned.view(np.bool_), least)


@accelerated
def range_view(nearest_m: NDArray[np.float32]) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    """Returns around each direction of (cells,) nearest ranges, and the least range there."""
    image = nearest_m.reshape(ROWS, COLUMNS)
    around = filled_around(np.isfinite(image))
    seen = np.bincount(around.ravel(), minlength=10)[1:].cumsum()  # by the cells around
    usual = 1 + int(np.searchsorted(seen, seen[-1] / 2))
    enough = ENOUGH if usual >= ENOUGH else 1
    return (around >= enough).ravel().view(np.uint8), least_of_neighbours(image).ravel()


def filled_around(image: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Number of filled cells among each filled cell of (rows, columns) and its eight neighbours, else 0.

    Columns wrap around.
    """
    one = image.view(np.uint8)
    across = one.copy()
    across[:, 1:] += one[:, :-1]
    across[:, :-1] += one[:, 1:]
    across[:, 0] += one[:, -1]
    across[:, -1] += one[:, 0]
    around = across.copy()
    around[1:] += across[:-1]
    around[:-1] += across[1:]
    around *= one
    return around


@accelerated
def nearest_by_direction(points: NDArray[np.float32]) -> NDArray[np.float32]:
    """Nearest range of (n, 3) points in each of (cells,) directions from the origin, inf without a point."""
    x, y, z = np.ascontiguousarray(points.T)
    distance = np.sqrt(x * x + y * y + z * z)
    image = np.full(ROWS * COLUMNS, np.inf, np.float32)
    far = distance > NEAREST_M
    np.minimum.at(image, cells_of(points)[far], distance[far])
    return image


def cells_of(points: NDArray[np.float32]) -> NDArray[np.int32]:
    """(n,) cell of ``nearest_by_direction`` in which each of (n, 3) points lies, seen from the origin."""
    x, y, z = np.ascontiguousarray(points.T)
    column = ((atan2_turns(y, x) + np.float32(0.5)) * np.float32(COLUMNS)).astype(np.int32)
    elevation = atan2_turns(z, np.sqrt(x * x + y * y))
    row = ((elevation + np.float32(0.25)) * np.float32(COLUMNS)).astype(np.int32)
    cells: NDArray[np.int32] = np.minimum(row, ROWS - 1) * COLUMNS + column % COLUMNS
    return cells


@cache
def directions() -> NDArray[np.float32]:
    """Unit vectors (cells, 3) through the middles of the cells of ``nearest_by_direction``, read-only."""
    azimuth = (np.arange(COLUMNS) + 0.5) * _RADIANS_A_CELL - np.pi
    elevation = ((np.arange(ROWS) + 0.5) * _RADIANS_A_CELL - np.pi / 2)[:, None]
    x, y = np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth)
    z = np.broadcast_to(np.sin(elevation), x.shape)
    through = np.stack([x, y, z], axis=-1).reshape(-1, 3).astype(np.float32)
    through.setflags(write=False)
    return through


@accelerated
def least_of_neighbours(image: NDArray[np.float32]) -> NDArray[np.float32]:
    """Minimum of each cell of (rows, columns) and its eight neighbours; columns wrap around."""
    across = np.minimum(np.minimum(np.roll(image, 1, axis=1), np.roll(image, -1, axis=1)), image)
    least = across.copy()
    np.minimum(least[1:], across[:-1], out=least[1:])
    np.minimum(least[:-1], across[1:], out=least[:-1])
    return least
