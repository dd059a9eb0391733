"""A building, driven through in parts: clouds of sessions as SLAM would leave them, with the truth."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from firstfix.sensor import SensorModel, preset
from firstfix.transform import inverse, make_transform, rotation_z, transform_points
from firstfix_builder.mesh.mesh import Mesh
from firstfix_builder.simulation.rays import Rays
from firstfix_builder.simulation.simulate import Simulator
from tests.builder.box_scenes import box, floor

LENGTH_M, WIDTH_M, WALL_M, HEIGHT_M = 32.0, 11.0, 0.15, 2.8
CORRIDOR_M = (4.5, 6.7)
SENSOR_M = 0.9
DOOR_M = 1.1
STEP_M = 0.7


@dataclass(frozen=True)
class Building:
    """Rooms on both sides of a corridor, with things in them.

    Attributes:
        mesh: all surfaces.
        path_m: (k, 2) where a robot drives: along the corridor, in at every door and out again.
    """

    mesh: Mesh
    path_m: NDArray[np.float64]

    @property
    def corners(self) -> NDArray[np.float64]:
        """(8, 3) of the box around it."""
        return np.array([[x, y, z] for x in (0, LENGTH_M) for y in (0, WIDTH_M) for z in (0, HEIGHT_M)])


def building(seed: int, *, things: int | None = None, moved: float = 0.0) -> Building:
    """A building by its seed.

    Args:
        things: seed of what stands in the rooms; None: the building's own. With another one the walls are the
            same: another storey.
        moved: share of the things that have moved.
    """
    rng = np.random.default_rng(seed)
    parts = [floor(-0.5, -0.5, LENGTH_M + 0.5, WIDTH_M + 0.5), *_shell()]
    south, north = CORRIDOR_M
    stops = []
    for low, high, side in ((0.0, south, -1), (north, WIDTH_M, 1)):
        at = 0.0
        while at < LENGTH_M - 0.1:
            width = min(float(rng.uniform(3.0, 6.0)), LENGTH_M - at)
            width = LENGTH_M - at if LENGTH_M - at - width < 3.0 else width
            door = at + float(rng.uniform(0.4, width - DOOR_M - 0.4))
            parts += _room(at, at + width, low, high, door, side)
            stops.append((door + DOOR_M / 2, (low + high) / 2))
            at += width
    parts += _things(np.random.default_rng([seed if things is None else things, 1]), moved)
    path = [np.array([[1.0, sum(CORRIDOR_M) / 2]])]
    for x, y in sorted(stops):
        for goal in ((x, sum(CORRIDOR_M) / 2), (x, y), (x, sum(CORRIDOR_M) / 2)):
            path.append(_towards(path[-1][-1], np.array(goal)))
    return Building(Mesh.joined(parts), np.concatenate(path))


@dataclass(frozen=True)
class Session:
    """A session's map and the truth.

    Attributes:
        cloud: (n, 3), in the session's own frame; trajectory: (m, 4, 4) of the sensor.
        T_world_session: (4, 4) truth.
    """

    cloud: NDArray[np.float64]
    trajectory: NDArray[np.float64]
    T_world_session: NDArray[np.float64]

    def write(self, folder: Path) -> None:
        """Leaves ``cloud.npy`` and ``poses.txt`` (KITTI rows)."""
        folder.mkdir(parents=True, exist_ok=True)
        np.save(folder / "cloud.npy", self.cloud)
        np.savetxt(folder / "poses.txt", self.trajectory[:, :3].reshape(-1, 12))


def session(
    place: Building,
    from_m: float,
    to_m: float,
    seed: int,
    *,
    step_m: float = 0.08,
    bend_deg: float = 0.0,
    at_home: bool = False,
) -> Session:
    """Drives through the part of the building between two x, and maps what is seen.

    Args:
        step_m: between the cloud's points.
        bend_deg: by which the end of the drive is turned against its beginning, as drift does it.
        at_home: whether its frame is the building's.
    """
    rng = np.random.default_rng(seed)
    path = place.path_m[(place.path_m[:, 0] >= from_m) & (place.path_m[:, 0] <= to_m)]
    simulator = Simulator(place.mesh.vertices, place.mesh.triangles)
    sensor = _sensor()
    rays = Rays.at_any_heading(sensor)
    T = np.tile(np.eye(4), (len(path), 1, 1))
    T[:, :2, 3], T[:, 2, 3] = path, SENSOR_M
    clouds = []
    for T_world_sensor, ranges in zip(
        T, np.concatenate(list(simulator.ranges(T, sensor, rays))), strict=True
    ):
        seen = np.isfinite(ranges) & (ranges < 12)
        noisy = ranges[seen] + rng.normal(0, 0.01, seen.sum())
        clouds.append(rays.directions[seen] * noisy[:, None] + T_world_sensor[:3, 3])
    bends = [_bend(path[i, 0], (from_m, to_m), bend_deg) for i in range(len(path))]
    cloud = np.concatenate([transform_points(B, c) for B, c in zip(bends, clouds, strict=True)])
    T = np.stack([B @ pose for B, pose in zip(bends, T, strict=True)])
    T_world_session = np.eye(4) if at_home else _anywhere(rng)
    T_session_world = inverse(T_world_session)
    thinned = cloud[_first_in_cell(cloud, step_m)]
    return Session(transform_points(T_session_world, thinned), T_session_world @ T, T_world_session)


def _first_in_cell(cloud: NDArray[np.float64], cell_m: float) -> NDArray[np.intp]:
    """The first point's row of each cell, by x, then y, then z.

    A cell is one number here: sorting millions of rows of three takes ten times as long.
    """
    cells = np.floor(cloud / cell_m).astype(np.int64)
    cells -= cells.min(axis=0)
    return np.unique(np.ravel_multi_index(tuple(cells.T), tuple(cells.max(axis=0) + 1)), return_index=True)[1]


def _bend(x: float, ends: tuple[float, float], bend_deg: float) -> NDArray[np.float64]:
    """A circle's arc in place of the straight corridor."""
    along = (x - ends[0]) / (ends[1] - ends[0])
    turn = np.radians(bend_deg) * along
    length = ends[1] - ends[0]
    sideways = length * np.radians(bend_deg) * along**2 / 2
    about = np.array([x, sum(CORRIDOR_M) / 2, 0.0])
    R = rotation_z(turn)
    return make_transform(R, about - R @ about + [0, sideways, 0])


def _anywhere(rng: np.random.Generator) -> NDArray[np.float64]:
    roll, pitch = np.radians(rng.uniform(-3, 3, 2))
    about_x = np.array([[1, 0, 0], [0, np.cos(roll), -np.sin(roll)], [0, np.sin(roll), np.cos(roll)]])
    about_y = np.array([[np.cos(pitch), 0, np.sin(pitch)], [0, 1, 0], [-np.sin(pitch), 0, np.cos(pitch)]])
    return make_transform(
        rotation_z(rng.uniform(-np.pi, np.pi)) @ about_y @ about_x, rng.uniform(-60, 60, 3) * [1, 1, 0.05]
    )


def _sensor() -> SensorModel:
    return preset("os1-64").coarser(12_000)


def _shell() -> list[Mesh]:
    t = WALL_M
    return [
        box((-t, -t, -0.1), (LENGTH_M + t, 0, HEIGHT_M)),
        box((-t, WIDTH_M, -0.1), (LENGTH_M + t, WIDTH_M + t, HEIGHT_M)),
        box((-t, -t, -0.1), (0, WIDTH_M + t, HEIGHT_M)),
        box((LENGTH_M, -t, -0.1), (LENGTH_M + t, WIDTH_M + t, HEIGHT_M)),
    ]


def _room(x0: float, x1: float, y0: float, y1: float, door: float, side: int) -> list[Mesh]:
    """The wall to the next room, and that to the corridor with its door."""
    y = y1 if side < 0 else y0
    t = WALL_M / 2
    walls = [
        box((x0 - t, y - t, -0.1), (door, y + t, HEIGHT_M)),
        box((door + DOOR_M, y - t, -0.1), (x1 + t, y + t, HEIGHT_M)),
    ]
    if x1 < LENGTH_M - 0.1:
        walls.append(box((x1 - t, y0, -0.1), (x1 + t, y1, HEIGHT_M)))
    return walls


def _things(rng: np.random.Generator, moved: float) -> list[Mesh]:
    """Tables, cupboards, boxes: along the rooms' far walls, out of the robot's way."""
    parts = []
    for _ in range(44):
        size = rng.uniform((0.4, 0.4, 0.5), (1.4, 0.8, 2.1))
        north = rng.random() < 0.5
        x = rng.uniform(0.8, LENGTH_M - 0.8)
        away = rng.uniform(0.5, 1.1)
        moves, by = rng.random() < moved, rng.choice([-1, 1]) * rng.uniform(1.0, 2.0)
        if moves:
            x = float(np.clip(x + by, 0.8, LENGTH_M - 0.8))
        y = WIDTH_M - away if north else away
        low = (x - size[0] / 2, y - size[1] / 2, 0.0)
        parts.append(box(low, (x + size[0] / 2, y + size[1] / 2, float(size[2]))))
    return parts


def _towards(start: NDArray[np.float64], goal: NDArray[np.float64]) -> NDArray[np.float64]:
    steps = max(int(np.ceil(np.linalg.norm(goal - start) / STEP_M)), 1)
    return start + (goal - start) * (np.arange(1, steps + 1) / steps)[:, None]
