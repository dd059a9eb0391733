"""A place before anything is measured in it: its solids, what may move, and where the robot drives."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from firstfix.sensor import SensorModel
from firstfix.transform import make_transform, rotation_between, rotation_z
from firstfix_builder.mesh.mesh import Mesh

from .primitives import placed, transformed

Ground = Callable[[NDArray[np.float64], NDArray[np.float64]], NDArray[np.float64]]


@dataclass(frozen=True)
class Movable:
    """An object that may stand elsewhere on another day.

    Attributes:
        shape: the solid, standing on the origin of its own frame.
        T_map_shape: (4, 4) where it belongs.
        present: whether it was there when the map was made; if not, it may turn up later.
        reach_m: how far it is likely to be pushed.
    """

    shape: Mesh
    T_map_shape: NDArray[np.float64]
    present: bool = True
    reach_m: float = 0.8

    def mesh(self) -> Mesh:
        """The shape where it stands."""
        return transformed(self.shape, self.T_map_shape)


@dataclass
class Place:
    """The layout of a world.

    Attributes:
        sensor: the robot's LiDAR.
        path: (p, 3) corner points of the drive, on the floor.
        voxel_m: of the map cloud.
        stride_m: driven between two mapping scans.
        corner_m: how far the robot rounds a corner.
        ground: height of the ground over (x, y); None for level floors, then the path carries its own z.
        fixed: solids that stay for ever.
        movables: solids that do not.
    """

    sensor: SensorModel
    path: NDArray[np.float64]
    voxel_m: float
    stride_m: float
    corner_m: float = 0.3
    ground: Ground | None = None
    fixed: list[Mesh] = field(default_factory=list)
    movables: list[Movable] = field(default_factory=list)

    def fix(self, shape: Mesh, x: float = 0.0, y: float = 0.0, z: float = 0.0, yaw_rad: float = 0.0) -> None:
        """Stands something for ever at (x, y), z above the ground, upright."""
        if self.ground is not None:
            z += float(self.ground(np.array([x]), np.array([y]))[0])
        self.fixed.append(placed(shape, x, y, z, yaw_rad))

    def put(
        self,
        shape: Mesh,
        x: float,
        y: float,
        z: float = 0.0,
        yaw_rad: float = 0.0,
        *,
        present: bool = True,
        reach_m: float = 0.8,
    ) -> None:
        """Stands a movable at (x, y); on a slope it leans with the ground."""
        self.movables.append(Movable(shape, self._stand(x, y, z, yaw_rad), present, reach_m))

    def _stand(self, x: float, y: float, z: float, yaw_rad: float) -> NDArray[np.float64]:
        if self.ground is None:
            return make_transform(rotation_z(yaw_rad), [x, y, z])
        normal = ground_normals(self.ground, np.array([[x, y]]))[0]
        z = float(self.ground(np.array([x]), np.array([y]))[0])
        return make_transform(rotation_between([0, 0, 1], normal) @ rotation_z(yaw_rad), [x, y, z])

    def mesh(self) -> Mesh:
        """The place as it was mapped."""
        return Mesh.joined([*self.fixed, *(thing.mesh() for thing in self.movables if thing.present)])

    def changed_mesh(self, rng: np.random.Generator) -> Mesh:
        """The same place another day: of what can move, a part is gone, pushed aside or newly come."""
        parts = list(self.fixed)
        for thing in self.movables:
            fate, turn = rng.uniform(), thing.reach_m * rng.uniform(-0.8, 0.8)
            dx, dy = rng.uniform(-thing.reach_m, thing.reach_m, 2)
            if not thing.present:
                if fate < 0.35:
                    parts.append(thing.mesh())
            elif fate < 0.6:
                parts.append(thing.mesh())
            elif fate < 0.85:
                x, y, z = thing.T_map_shape[:3, 3]
                yaw = float(np.arctan2(thing.T_map_shape[1, 0], thing.T_map_shape[0, 0]))
                T = self._stand(x + dx, y + dy, z, yaw + turn)
                parts.append(transformed(thing.shape, T))
        return Mesh.joined(parts)


def ground_normals(ground: Ground, xy: NDArray[np.float64], span_m: float = 0.4) -> NDArray[np.float64]:
    """(n, 2) points to (n, 3) unit normals of the ground, over a robot's wheelbase."""
    x, y, h = xy[:, 0], xy[:, 1], span_m / 2
    slope_x = (ground(x + h, y) - ground(x - h, y)) / span_m
    slope_y = (ground(x, y + h) - ground(x, y - h)) / span_m
    normal = np.column_stack([-slope_x, -slope_y, np.ones(len(xy))])
    unit: NDArray[np.float64] = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    return unit
