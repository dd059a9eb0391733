"""The floors of one tile of a map, and what joins them to those of its neighbours."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from firstfix.builds.config import ViewpointConfig

from ..mesh.places.chance import rank_in_run
from ..simulation.simulate import Simulator
from .even_sample import FloorPoints, one_per_block
from .floors import Grid, Surfaces, find_surfaces, fit_planes
from .tiles import MAX_COLUMN, Tiling
from .trajectory_floor import with_trajectory_floor
from .traversable import connected_parts, gap_strides, has_room, passable_pairs
from .walled_rim import rim_and_walls

PLANE_REACH_M = 0.5
HEAD_ROOM_M = 0.1  # over the sensor


@dataclass(frozen=True)
class FloorSampling:
    """All that decides what a floor is, and which floors are joined.

    Attributes:
        mount_height_m: of the sensor.
        track_height_m: of the trajectory over its floor.
    """

    tiling: Tiling
    config: ViewpointConfig
    mount_height_m: float
    track_height_m: float

    @property
    def height_m(self) -> float:
        """Free height that the robot needs."""
        return max(self.config.robot_height_m, self.mount_height_m + HEAD_ROOM_M)

    @property
    def plane_cells(self) -> int:
        """Cells to every side of a floor that its slope comes from."""
        return max(1, round(PLANE_REACH_M / self.tiling.cell_m))

    @property
    def border_cells(self) -> int:
        """Cells around a tile with surfaces that its floors are joined to, and those of their planes."""
        return gap_strides(self.tiling.cell_m, self.config.bridge_gap_m) + self.plane_cells

    @property
    def reach_m(self) -> float:
        """Distance from the tile to which the mesh is read."""
        return self.border_cells * self.tiling.cell_m + self.config.footprint_radius_m + 0.1


@dataclass(frozen=True)
class TileFloors:
    """The floors of a tile in connected parts, which are numbered from 0.

    Attributes:
        floor_points: at most one for each block, storey and part.
        part: (n,) of each point.
        area, covered, above: (p,) cells of each part; of them with something overhead; and of them above
            another floor.
        rim, walled: (p,) sides of cells at which a part ends; and of them those with a wall.
        passed: (p,) whether the trajectory passed over a part.
        border, border_part: (b,) numbers of the floors near the tile's edge, and their parts.
        link, link_part: (k,) numbers of floors of other tiles, and the part here that each is joined to.
    """

    floor_points: FloorPoints
    part: NDArray[np.int32]
    area: NDArray[np.int64]
    covered: NDArray[np.int64]
    above: NDArray[np.int64]
    rim: NDArray[np.int64]
    walled: NDArray[np.int64]
    passed: NDArray[np.bool_]
    border: NDArray[np.int64]
    border_part: NDArray[np.int32]
    link: NDArray[np.int64]
    link_part: NDArray[np.int32]


def tile_floors(
    simulator: Simulator,
    sampling: FloorSampling,
    tile: tuple[int, int],
    foot: NDArray[np.float64] | None,
) -> TileFloors:
    """The floors of a tile. What another tile computes of its border is the same to the last bit.

    Args:
        simulator: of a mesh that is whole within ``sampling.reach_m`` of the tile.
        foot: (k, 3) points under the trajectory, in its order: all over the tile and its border, and within
            ``max_distance_to_trajectory_m`` of these; None: there is no trajectory.
    """
    config = sampling.config
    grid = sampling.tiling.grid(tile, sampling.border_cells)
    surfaces = find_surfaces(simulator, grid, _columns(grid, foot, config.max_distance_to_trajectory_m))
    passed = np.zeros(len(surfaces), bool)
    if foot is not None:
        surfaces, passed = with_trajectory_floor(grid, surfaces, foot)
    standing, passed = _standing(grid, surfaces, passed, sampling)
    feet = np.column_stack([grid.centre_m(standing.column), standing.z])
    room = has_room(simulator, feet, config.footprint_radius_m, config.step_height_m, sampling.height_m)
    room |= passed
    floors, passed = standing.subset(room), passed[room]
    low = sampling.border_cells
    last = low + sampling.tiling.side_cells
    inside = np.all((floors.column >= low) & (floors.column < last), axis=1)
    own = np.flatnonzero(inside)
    max_slope = float(np.tan(np.radians(config.max_slope_deg)))
    pairs = passable_pairs(
        simulator,
        grid,
        floors,
        own,
        step_m=config.step_height_m,
        max_slope=max_slope,
        bridge_gap_m=config.bridge_gap_m,
        height_m=sampling.height_m,
    )
    part = np.full(len(floors), -1)
    within = inside[pairs[:, 1]]
    place = np.cumsum(inside) - 1
    part[own] = connected_parts(place[pairs[within]], len(own))
    number = _numbers(grid, floors)
    out, link_part = number[pairs[~within, 1]], part[pairs[~within, 0]]
    links = np.unique(np.column_stack([out, link_part]), axis=0)
    reach = gap_strides(grid.cell_m, config.bridge_gap_m)
    near_edge = np.any((floors.column < low + reach) | (floors.column >= last - reach), axis=1)
    edge = inside & near_edge
    mine, my_part = floors.subset(own), part[own]
    count = int(my_part.max(initial=-1)) + 1
    rim, walls = rim_and_walls(
        simulator,
        grid,
        floors,
        own,
        step_m=config.step_height_m,
        max_slope=max_slope,
        radius_m=config.footprint_radius_m,
    )
    points, point_part = _floor_points(grid, mine, my_part, sampling.tiling.spacing_m)
    return TileFloors(
        points,
        point_part.astype(np.int32),
        np.bincount(my_part, minlength=count),
        np.bincount(my_part[np.isfinite(mine.headroom_m)], minlength=count),
        np.bincount(my_part[_over_another(grid, standing, mine)], minlength=count),
        np.bincount(my_part, weights=rim, minlength=count).astype(np.int64),
        np.bincount(my_part, weights=walls, minlength=count).astype(np.int64),
        np.isin(np.arange(count), my_part[passed[own]]),
        number[edge],
        part[edge].astype(np.int32),
        links[:, 0],
        links[:, 1].astype(np.int32),
    )


def _columns(grid: Grid, foot: NDArray[np.float64] | None, limit_m: float | None) -> NDArray[np.int64]:
    """(n, 2) the columns to look at: all, or those near the trajectory."""
    x, y = np.meshgrid(np.arange(grid.size[0]), np.arange(grid.size[1]), indexing="ij")
    columns = np.column_stack([x.ravel(), y.ravel()])
    if foot is None or limit_m is None:
        return columns
    if len(foot) == 0:
        return columns[:0]
    away, _ = cKDTree(foot[:, :2]).query(grid.centre_m(columns), distance_upper_bound=limit_m)
    return columns[np.isfinite(away)]


def _standing(
    grid: Grid, surfaces: Surfaces, passed: NDArray[np.bool_], sampling: FloorSampling
) -> tuple[Surfaces, NDArray[np.bool_]]:
    """The surfaces with headroom that are level enough, at their smoothed height; which were passed over."""
    config = sampling.config
    high = passed | (surfaces.headroom_m >= sampling.height_m)
    surfaces, passed = surfaces.subset(high), passed[high]
    plane_z, slope = fit_planes(grid, surfaces, sampling.plane_cells, config.step_height_m)
    even = slope <= np.tan(np.radians(config.max_slope_deg))
    tread = surfaces.level >= np.cos(np.radians(config.max_slope_deg))
    z = np.where(even & (np.abs(plane_z - surfaces.z) <= config.step_height_m), plane_z, surfaces.z)
    keep = passed | even | tread
    return replace(surfaces, z=z).subset(keep), passed[keep]


def _numbers(grid: Grid, floors: Surfaces) -> NDArray[np.int64]:
    """(n,) number of each floor, by its column and its place in it: the same from every tile."""
    column = floors.column + grid.low + MAX_COLUMN
    numbers: NDArray[np.int64] = (column[:, 0] << 35) | (column[:, 1] << 8) | rank_in_run(column)
    return numbers


def _over_another(grid: Grid, standing: Surfaces, floors: Surfaces) -> NDArray[np.bool_]:
    """(n,) which floors are not the lowest surface of their column that one could stand on."""
    flat = standing.column[:, 0] * grid.size[1] + standing.column[:, 1]
    lowest = np.full(int(np.prod(grid.size)), np.inf)
    np.minimum.at(lowest, flat, standing.z)
    own = floors.column[:, 0] * grid.size[1] + floors.column[:, 1]
    over: NDArray[np.bool_] = floors.z > lowest[own] + 0.5
    return over


def _floor_points(
    grid: Grid, floors: Surfaces, part: NDArray[np.int64], spacing_m: float
) -> tuple[FloorPoints, NDArray[np.int64]]:
    """For each block, storey and part the floor nearest to the block's centre, and (n,) its part."""
    centre = grid.centre_m(floors.column)
    group, first = one_per_block(FloorPoints.alone(centre, floors.z), spacing_m, part)
    low, high = np.full(len(first), np.inf), np.full(len(first), -np.inf)
    np.minimum.at(low, group, floors.z)
    np.maximum.at(high, group, floors.z)
    return FloorPoints(centre[first], floors.z[first], low, high), part[first]
