"""A world's map before and after something in a part of it has moved."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firstfix_cli.sample_world import World
from firstfix_cli.sample_world.write_world import ply_of_cloud, write_world

from ...worlds import make_world
from ...worlds.city.city import City
from ...worlds.city.write_city import write_meshes

CITY_SEED = 7
_FLOOR_M = 0.15  # what lies lower is floor, and stays


@dataclass(frozen=True)
class Change:
    """Everything above the floor in a part of a world's map moves.

    Attributes:
        world: its name.
        at: share of the mapping run at which the part has its centre.
        size_m: of the part, along the run and across it.
        shift_m: how far it moves, along the run.
        config: of the builds.
    """

    name: str
    world: str
    at: float
    size_m: tuple[float, float]
    shift_m: float
    config: Mapping[str, Any] = field(default_factory=dict)

    def write(self, folder: Path) -> ChangedMap:
        """Make the world, and write its map before and after the change."""
        return _changed_world(self, folder)


@dataclass(frozen=True)
class RebuiltBlock:
    """Other houses stand in one block of a city.

    Attributes:
        side: blocks along x and along y.
        block: number of the block.
        config: of the builds.
    """

    name: str
    side: int
    block: tuple[int, int]
    config: Mapping[str, Any] = field(default_factory=dict)

    def write(self, folder: Path) -> ChangedMap:
        """Write the city's surfaces before and after the change."""
        city = City(self.side, CITY_SEED)
        write_meshes(city, folder / "before")
        write_meshes(replace(city, rebuilt=frozenset({self.block})), folder / "after")
        config = {**self.config, "sensor": city.block(0, 0).sensor.to_mapping()}
        moved = round(1 / self.side**2, 5)
        return ChangedMap(folder / "before", folder / "after", None, config, moved)


@dataclass(frozen=True)
class ChangedMap:
    """Files of a map before and after a change.

    Attributes:
        trajectory: TUM file of the mapping run, of both; None: there is none.
        moved: share of the points, or of the blocks, that have moved.
    """

    before: Path
    after: Path
    trajectory: Path | None
    config: dict[str, Any]
    moved: float


def _changed_world(change: Change, folder: Path) -> ChangedMap:
    world = make_world(change.world)
    write_world(world, folder)
    points, moved = changed_points(world, change)
    after = folder / "after.ply"
    after.write_bytes(ply_of_cloud(points))
    config = {**change.config, "sensor": world.sensor.to_mapping()}
    return ChangedMap(
        folder / "map.ply", after, folder / "trajectory.txt", config, round(float(moved.mean()), 5)
    )


def changed_points(world: World, change: Change) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """The points (n, 3) of the map after the change, and which of them have moved (n,)."""
    moved, along = _part(world, change)
    points = np.array(world.cloud, np.float64)
    points[moved] += change.shift_m * along
    return points, moved


def _part(world: World, change: Change) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
    """Which points (n,) move, and the direction (3,) in which they do."""
    poses = world.trajectory
    k = round(change.at * (len(poses) - 1))
    centre, sensor_z = poses[k, :2, 3], poses[k, 2, 3]
    step = poses[min(k + 1, len(poses) - 1), :2, 3] - poses[max(k - 1, 0), :2, 3]
    forward = step / np.linalg.norm(step)
    offset = world.cloud[:, :2] - centre
    lengthwise, across = offset @ forward, offset @ np.array([-forward[1], forward[0]])
    near = (abs(lengthwise) < change.size_m[0] / 2) & (abs(across) < change.size_m[1] / 2)
    height_m = world.cloud[:, 2] - (sensor_z - world.sensor.mount_height_m)
    return near & (height_m > _FLOOR_M), np.array([*forward, 0.0])
