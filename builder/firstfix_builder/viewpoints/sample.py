"""Samples the sensor positions of the templates, over the floors that a robot can reach (paper III.A)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from firstfix.builds.config import ViewpointConfig
from firstfix.errors import BuildFailed

from ..simulation.simulate import Simulator
from .drivable_components import components_under, drivable_components
from .floors import Grid, Surfaces, find_surfaces, fit_planes
from .one_per_block import one_per_block
from .trajectory_floor import TrajectoryFloor, trajectory_floor, with_trajectory_floor
from .traversable import has_room, traversable_components

MAX_CELL_M = 0.4
DEFAULT_SPACING_M = 1.0
PLANE_REACH_M = 0.5
MAX_COLUMNS = 50e6  # 2.3 km square at 1/3 m
HEAD_ROOM_M = 0.1  # over the sensor


@dataclass(frozen=True)
class Viewpoints:
    """Sensor positions of the templates.

    Attributes:
        positions: (n, 3) of the sensor, metres, map frame.
        floor_z: (n,) height of the floor below each.
        mount_height_m: the difference.
    """

    positions: NDArray[np.float64]
    floor_z: NDArray[np.float64]
    mount_height_m: float

    def __len__(self) -> int:
        return len(self.positions)

    def subset(self, keep: NDArray[np.bool_] | NDArray[np.int64]) -> Viewpoints:
        """Returns the chosen viewpoints."""
        return Viewpoints(self.positions[keep], self.floor_z[keep], self.mount_height_m)


def sample_viewpoints(
    simulator: Simulator,
    config: ViewpointConfig,
    mount_height_m: float,
    trajectory: NDArray[np.float64] | None = None,
    seeds: NDArray[np.float64] | None = None,
) -> Viewpoints:
    """Viewpoints on every floor that is reached from the trajectory or the seeds.

    With neither of them, on the largest floor that is no roof and on storeys of comparable size.

    Args:
        mount_height_m: the sensor model's, for mount_height_m = "auto" without a trajectory.
        trajectory: (m, 4, 4) T_map_sensor, or None.
        seeds: (k, 3) metres, places in free space above the floor to start from, or None.

    Raises:
        BuildFailed: there is no floor to stand on, none under the trajectory, or the map is too large.
    """
    spacing_m = config.spacing_m or DEFAULT_SPACING_M
    cell_m = spacing_m / int(np.ceil(spacing_m / MAX_CELL_M))
    under_track = None
    if trajectory is not None and len(trajectory):
        under_track = trajectory_floor(simulator, trajectory, cell_m / 2, mount_height_m)
    if config.mount_height_m != "auto":
        mount_height_m = config.mount_height_m
    elif under_track is not None:
        mount_height_m = under_track.mount_height_m
    grid = Grid.over(simulator.low, simulator.high, cell_m)
    if float(np.prod(grid.size.astype(np.float64))) > MAX_COLUMNS:
        raise BuildFailed(f"the map is too large for cells of {cell_m:.2f} m: set a larger spacing_m")
    surfaces = find_surfaces(simulator, grid, _columns(grid, under_track, config))
    passed = np.zeros(len(surfaces), bool)
    if under_track is not None:
        surfaces, passed = with_trajectory_floor(grid, surfaces, under_track.foot)
    height_m = max(config.robot_height_m, mount_height_m + HEAD_ROOM_M)
    standing, passed = _standing(grid, surfaces, passed, config, height_m)
    feet = np.column_stack([grid.centre_m(standing.column), standing.z])
    room = passed | has_room(simulator, feet, config.footprint_radius_m, config.step_height_m, height_m)
    floors = standing.subset(room)
    if len(floors) == 0:
        near = "" if under_track is None else " near the trajectory"
        raise BuildFailed(f"the map has no floor with room for the robot{near}")
    part = traversable_components(
        simulator,
        grid,
        floors,
        step_m=config.step_height_m,
        max_slope=float(np.tan(np.radians(config.max_slope_deg))),
        bridge_gap_m=config.bridge_gap_m,
        height_m=height_m,
    )
    if under_track is None and seeds is None:
        chosen = drivable_components(grid, standing, floors, part)
    else:
        chosen = part[passed[room]]
        if seeds is not None:
            chosen = np.union1d(chosen, components_under(grid, floors, part, seeds))
        if len(chosen) == 0:
            raise BuildFailed("no floor of the map lies under the trajectory or the seeds: another frame?")
    return _one_per_block(grid, floors.subset(np.isin(part, chosen)), spacing_m, mount_height_m)


def _columns(grid: Grid, under_track: TrajectoryFloor | None, config: ViewpointConfig) -> NDArray[np.int64]:
    """(n, 2) the columns to look at: all, or those near the trajectory."""
    x, y = np.meshgrid(np.arange(grid.size[0]), np.arange(grid.size[1]), indexing="ij")
    columns = np.column_stack([x.ravel(), y.ravel()])
    limit_m = config.max_distance_to_trajectory_m
    if under_track is None or limit_m is None:
        return columns
    away, _ = cKDTree(under_track.foot[:, :2]).query(grid.centre_m(columns), distance_upper_bound=limit_m)
    return columns[np.isfinite(away)]


def _standing(
    grid: Grid, surfaces: Surfaces, passed: NDArray[np.bool_], config: ViewpointConfig, height_m: float
) -> tuple[Surfaces, NDArray[np.bool_]]:
    """The surfaces with headroom that are level enough, at their smoothed height; which were passed over."""
    high = passed | (surfaces.headroom_m >= height_m)
    surfaces, passed = surfaces.subset(high), passed[high]
    reach = max(1, round(PLANE_REACH_M / grid.cell_m))
    plane_z, slope = fit_planes(grid, surfaces, reach, config.step_height_m)
    even = slope <= np.tan(np.radians(config.max_slope_deg))
    tread = surfaces.level >= np.cos(np.radians(config.max_slope_deg))
    z = np.where(even & (np.abs(plane_z - surfaces.z) <= config.step_height_m), plane_z, surfaces.z)
    keep = passed | even | tread
    return replace(surfaces, z=z).subset(keep), passed[keep]


def _one_per_block(grid: Grid, floors: Surfaces, spacing_m: float, mount_height_m: float) -> Viewpoints:
    """For each block of the spacing and each storey in it, the floor nearest to the block's centre."""
    centre = grid.centre_m(floors.column)
    _, first = one_per_block(centre, floors.z, spacing_m)
    floor_z = floors.z[first]
    positions = np.column_stack([centre[first], floor_z + mount_height_m])
    return Viewpoints(positions, floor_z, mount_height_m)
