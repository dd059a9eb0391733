"""hdl_global_localization's search engine BBS by its published method (koide3, BSD-2), then ICP.

A slice of the map becomes a grid of occupied cells, and a slice of the scan is searched in it by branch and
bound over x, y and yaw. It has the true direction of gravity, because it takes the robot to stand upright,
and the height at which the mapping sensor was carried: both slices are at this height. Parameters of its
``config/bbs_config.yaml``, but the search covers the whole map. Its confidence is the share of the scan's
points in occupied cells. It has no threshold, so each answer is accepted.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from firstfix.builds.config import BuildConfig
from firstfix.scan.levelling import levelling_rotation
from firstfix.scan.reduction import voxel_means
from firstfix.scan.scan import Scan
from firstfix.transform import make_transform, rotation_z

from .answer import Answer
from .icp import Icp
from .peer_input import PeerInput
from .prior import Prior
from .sent import points_bytes

RESOLUTION_M, LEVELS, FULL_CELL_POINTS = 0.5, 6, 5
MAX_RANGE_M = 15.0  # decides the step of the yaw
HALF_SLICE_M = 0.2
QUERY_VOXEL_M, MAP_VOXEL_M = 0.5, 0.1
MIN_POINTS = 32  # of the scan's slice
BATCH = 256
MAX_AT_ONCE = 1_000_000  # values
ICP_REACH_M = 1.5


class Bbs2d:
    sent_bytes = staticmethod(points_bytes)

    def __init__(self, given: PeerInput) -> None:
        points = given.map_points()
        self._given = given
        self._height_m = float(np.median([T[2, 3] for T in given.mapping_poses()]))
        reach_m = BuildConfig.parse(given.dataset.config).sensor_model.max_range_m
        self._grid = GridPyramid(at_height(voxel_means(points, MAP_VOXEL_M), self._height_m), reach_m)
        self._icp = Icp(points, ICP_REACH_M)

    def __call__(self, scan: Scan, prior: Prior) -> Answer:
        points = self._given.cropped(scan)
        T_level_sensor = make_transform(levelling_rotation(-prior.gravity), np.zeros(3))
        slice_xy = at_height(voxel_means(points @ T_level_sensor[:3, :3].T, QUERY_VOXEL_M), 0.0)
        if len(slice_xy) < MIN_POINTS:
            return Answer()
        x_m, y_m, yaw_rad, share = self._grid.search(slice_xy)
        T_map_level = make_transform(rotation_z(yaw_rad), np.array([x_m, y_m, self._height_m]))
        return Answer(self._icp.refine(points, T_map_level @ T_level_sensor), share, True)


class GridPyramid:
    """Occupancy of the map's cells. In level k a cell has the largest value of 2^k x 2^k cells from it on.

    Args:
        points: (m, 2) of the map's slice.
        reach_m: of the scans.
    """

    def __init__(self, points: NDArray[np.float64], reach_m: float) -> None:
        cells = np.floor(points / RESOLUTION_M).astype(np.int64)
        self._margin = int(np.ceil(reach_m / RESOLUTION_M)) + 2 ** (LEVELS - 1)  # nothing is asked beyond it
        self._low = cells.min(axis=0)
        self._size = cells.max(axis=0) - self._low + 1
        counts = np.zeros(self._size + 2 * self._margin, np.int64)
        np.add.at(counts, tuple((cells - self._low + self._margin).T), 1)
        levels = [np.minimum(counts / FULL_CELL_POINTS, 1.0).astype(np.float32)]
        for level in range(1, LEVELS):
            levels.append(_doubled(levels[-1], 2 ** (level - 1)))
        self._width = counts.shape[1]
        self._levels = [np.ascontiguousarray(grid).ravel() for grid in levels]

    def search(self, points: NDArray[np.float64]) -> tuple[float, float, float, float]:
        """X and y in metres, the yaw in radians, and the share of the points in occupied cells.

        Args:
            points: (n, 2) of the scan's slice, within the reach.
        """
        step_rad = np.arccos(1 - RESOLUTION_M**2 / (2 * MAX_RANGE_M**2))
        yaws = np.arange(0.0, 2 * np.pi, step_rad)
        turned = np.stack([points @ rotation_z(yaw)[:2, :2].T for yaw in yaws])  # (yaws, n, 2)
        cells = np.floor(turned / RESOLUTION_M).astype(np.int64) + self._margin
        places = cells[..., 0] * self._width + cells[..., 1]  # (yaws, n): index of each point's cell
        coarse = 2 ** (LEVELS - 1)
        at = np.meshgrid(
            np.arange(len(yaws)), *(np.arange(0, size, coarse) for size in self._size), indexing="ij"
        )
        nodes = np.stack([axis.ravel() for axis in at], axis=1)  # (k, 3): yaw, x, y
        waiting = {LEVELS - 1: (nodes, self._scores(places, nodes, LEVELS - 1))}
        best, best_node = -1.0, nodes[0]
        while waiting:
            # The best of the finest level that waits: leaves come early, and cut the rest.
            level = min(waiting)
            nodes, bounds = waiting.pop(level)
            alive = bounds > best
            nodes, bounds = nodes[alive], bounds[alive]
            if not len(nodes):
                continue
            order = np.argsort(-bounds, kind="stable")
            if len(order) > BATCH:
                waiting[level] = nodes[order[BATCH:]], bounds[order[BATCH:]]
            children = _children(nodes[order[:BATCH]], 2 ** (level - 1))
            scores = self._scores(places, children, level - 1)
            if level > 1:
                waiting[level - 1] = children, scores
            elif scores.max() > best:
                best, best_node = float(scores.max()), children[int(np.argmax(scores))]
        x_m, y_m = (best_node[1:] + self._low) * RESOLUTION_M
        return float(x_m), float(y_m), float(yaws[best_node[0]]), best / len(points)

    def _scores(self, places: NDArray[np.int64], nodes: NDArray[np.int64], level: int) -> NDArray[np.float64]:
        """(yaws, n) cells of the scan and (k, 3) nodes to (k,) sums of the values under the points."""
        offsets = nodes[:, 1] * self._width + nodes[:, 2]
        chunk = max(1, MAX_AT_ONCE // places.shape[1])
        parts = []
        for begin in range(0, len(nodes), chunk):
            part = slice(begin, begin + chunk)
            parts.append(self._levels[level][places[nodes[part, 0]] + offsets[part, None]].sum(axis=1))
        return np.concatenate(parts).astype(np.float64)


def at_height(points: NDArray[np.float64], height_m: float) -> NDArray[np.float64]:
    """(n, 3) points to the (k, 2) near a height."""
    return points[np.abs(points[:, 2] - height_m) < HALF_SLICE_M, :2]


def _doubled(grid: NDArray[np.float32], offset: int) -> NDArray[np.float32]:
    """(w, h) values to the largest of each cell and the three that are ``offset`` further."""
    padded = np.pad(grid, ((0, offset), (0, offset)))
    across = np.maximum(padded[:-offset], padded[offset:])
    return np.maximum(across[:, :-offset], across[:, offset:])


def _children(nodes: NDArray[np.int64], half: int) -> NDArray[np.int64]:
    """(k, 3) nodes to the (4k, 3) of half their size."""
    offsets = np.array([[0, 0, 0], [0, half, 0], [0, 0, half], [0, half, half]])
    return (nodes[:, None] + offsets).reshape(-1, 3)
