"""A hall of boxes whose racks move: its map as points, and scans in the changed hall."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import cast

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from firstfix.engine.config import EngineConfig, RegistrationConfig
from firstfix.engine.index import MapIndex, MapView
from firstfix.engine.registration.align import MapSurface
from firstfix.engine.registration.surface import Surface
from firstfix.native import CarvedCells
from firstfix.scan.scan import Scan
from firstfix.sensor import SensorModel
from firstfix.transform import make_transform, rotation_z
from firstfix_builder.index.carve import BACK_OFF_M, RAYS, cell_width_m, merged, seen_free
from firstfix_builder.simulation.boxes import Boxes
from firstfix_builder.simulation.rays import Rays
from firstfix_builder.simulation.simulate import Simulator, upright

SENSOR = SensorModel.from_mapping(
    {
        "name": "test-40",
        "elevations_deg": [float(v) for v in np.linspace(-40, 38, 40)],
        "azimuth_step_deg": 1.0,
        "min_range_m": 0.3,
        "max_range_m": 60.0,
        "mount_height_m": 1.0,
    }
)


@dataclass(frozen=True)
class Hall:
    """Walls, floor and ceiling around (0, 0, 0) to ``size_m``, with boxes in it.

    Attributes:
        size_m: (3,).
        things: boxes that stand in the hall.
    """

    size_m: tuple[float, float, float]
    things: Boxes

    def simulator(self) -> Simulator:
        return Simulator(*Boxes.joined(self._shell(), self.things).mesh())

    @cached_property
    def index(self) -> MapIndex:
        """A version of this hall, as far as sightings need one."""
        points, normals = self.points_and_normals
        surface = Surface(points, normals, np.ones(len(points), bool))
        parts = EngineConfig(), None, None, MapSurface.of(surface, RegistrationConfig())
        return MapIndex(*cast("tuple", parts), MapView.of(points, 25.0))

    @cached_property
    def points_and_normals(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Points (n, 3) of its surfaces, and their normals."""
        vertices, triangles = Boxes.joined(self._shell(), self.things).mesh()
        points, normals = surface_points(vertices[triangles], 0.2)
        inside = ((points > -0.005) & (points < np.array(self.size_m) + 0.005)).all(axis=1)
        return points[inside].astype(np.float32), normals[inside].astype(np.float32)

    def scan(
        self,
        simulator: Simulator,
        T_map_sensor: NDArray[np.float64],
        rng: np.random.Generator,
        people: float = 0.0,
    ) -> Scan:
        """A scan with noise. ``people``: how many stand in the way on average."""
        rays = Rays.of_sensor(SENSOR)
        ranges = next(simulator.ranges(T_map_sensor[None], SENSOR, rays))[0]
        ranges = ranges + rng.normal(0, 0.02, len(ranges)).astype(np.float32)
        for _ in range(rng.poisson(people)):
            ranges = behind_person(ranges, rays.directions, rng)
        seen = np.isfinite(ranges)
        return Scan.from_points(rays.directions[seen] * ranges[seen, None])

    def _shell(self) -> Boxes:
        x, y, z = self.size_m
        thick = 0.2
        boxes = [
            ((x / 2, y / 2, -thick / 2), (x / 2, y / 2, thick / 2)),
            ((x / 2, y / 2, z + thick / 2), (x / 2, y / 2, thick / 2)),
            ((x / 2, -thick / 2, z / 2), (x / 2, thick / 2, z / 2)),
            ((x / 2, y + thick / 2, z / 2), (x / 2, thick / 2, z / 2)),
            ((-thick / 2, y / 2, z / 2), (thick / 2, y / 2, z / 2)),
            ((x + thick / 2, y / 2, z / 2), (thick / 2, y / 2, z / 2)),
        ]
        return Boxes(np.array([c for c, _ in boxes]), np.array([h for _, h in boxes]), np.zeros(len(boxes)))


def behind_person(
    ranges: NDArray[np.float32], directions: NDArray[np.float32], rng: np.random.Generator
) -> NDArray[np.float32]:
    """Ranges of a scan that a person, half a metre wide and 1.8 m tall, stands in the way of."""
    away_m, azimuth = rng.uniform(1.5, 8.0), rng.uniform(-np.pi, np.pi)
    turned = np.angle(np.exp(1j * (np.arctan2(directions[:, 1], directions[:, 0]) - azimuth)))
    here = (np.abs(turned) < 0.25 / away_m) & (directions[:, 2] * away_m < 0.8)
    return np.where(here, np.minimum(ranges, np.float32(away_m)), ranges)


def standing(*boxes: tuple[float, float, float, float, float, float]) -> Boxes:
    """Boxes from low and high corners: x, y, z, x, y, z."""
    corners = np.array(boxes, np.float64).reshape(-1, 2, 3)
    return Boxes(corners.mean(axis=1), np.diff(corners, axis=1)[:, 0] / 2, np.zeros(len(corners)))


def surface_points(
    triangles: NDArray[np.float64], spacing_m: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Points with normals on (n, 3, 3) triangles, evenly by area, the same every time."""
    rng = np.random.default_rng(1)
    cross = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    area = np.linalg.norm(cross, axis=1) / 2
    chosen = rng.choice(len(triangles), int(4 * area.sum() / spacing_m**2), p=area / area.sum())
    u, v = rng.random((2, len(chosen), 1))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    a, b, c = triangles[chosen].transpose(1, 0, 2)
    return a + u * (b - a) + v * (c - a), (cross / (2 * area[:, None]))[chosen]


def pose(x: float, y: float, z: float = 1.0, yaw_rad: float = 0.0) -> NDArray[np.float64]:
    return make_transform(rotation_z(yaw_rad), [x, y, z])


def free_poses(simulator: Simulator, size_m: tuple[float, ...], count: int, rng: np.random.Generator) -> list:
    """Poses at free random places, any heading."""
    found: list[NDArray[np.float64]] = []
    while len(found) < count:
        at = np.column_stack([rng.uniform(0.5, size_m[0] - 0.5, 64), rng.uniform(0.5, size_m[1] - 0.5, 64)])
        at = np.column_stack([at, np.full(64, 1.0)])
        for spot in at[simulator.is_free(at, 0.4)]:
            found.append(pose(*spot, yaw_rad=rng.uniform(-np.pi, np.pi)))
    return found[:count]


def with_error(T: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float64]:
    """The pose as a localization would have found it: some centimetres and tenths of a degree off."""
    return T @ make_transform(rotation_z(rng.normal(0, np.radians(0.2))), rng.normal(0, 0.02, 3))


def warehouse(seed: int) -> tuple[Hall, Hall, Boxes, Boxes]:
    """A warehouse, the same after one aisle has moved, and the racks of this aisle before and after.

    Four double rows of racks, in bays of 2.5 x 1.1 m and of different heights, with gaps. Those of one row
    move to the open area beside.
    """
    rng = np.random.default_rng(seed)
    size_m = (36.0, 24.0, 7.0)
    rows: list[list[tuple[float, ...]]] = []
    for y in (3.23, 8.2, 13.28, 18.17):
        row = []
        for side in (0.0, 1.15):
            for bay in range(6):
                if rng.uniform() < 0.15:
                    continue
                height = rng.choice([1.8, 3.4, 5.0]) + rng.uniform(-0.3, 0.3)
                x = 3.2 + 2.5 * bay
                row.append((x, y + side, 0.0, x + 2.5, y + side + 1.1, height))
        rows.append(row)
    moves = int(rng.integers(4))
    dx, dy = rng.uniform(16.0, 17.0), rng.uniform(-0.8, 0.8)
    before = standing(*rows[moves])
    after = Boxes(before.centre_m + [dx, dy, 0.0], before.half_m, before.yaw)
    others = standing(*(box for k, row in enumerate(rows) if k != moves for box in row))
    pillars = standing(*((x, y, 0.0, x + 0.5, y + 0.5, 7.0) for x in (1.0, 19.5, 35.0) for y in (6.5, 16.5)))
    fixed = Boxes.joined(others, pillars)
    old, new = (Hall(size_m, Boxes.joined(fixed, racks)) for racks in (before, after))
    return old, new, before, after


def driven(
    hall: Hall,
    places_m: NDArray[np.float64],
    *,
    hidden: tuple[float, ...] | None = None,
    with_seen_free: bool = True,
) -> MapIndex:
    """A version of what a mapping run through these (n, 3) places saw of a hall.

    Args:
        hidden: low and high corner of a box into which no ray came.
        with_seen_free: keep the space that it saw free.
    """
    simulator, rays = hall.simulator(), Rays.at_any_heading(SENSOR.coarser(RAYS))
    carved, ends, row = CarvedCells(cell_width_m(RegistrationConfig())), [], 0
    for ranges in simulator.ranges(upright(places_m), SENSOR, rays):
        at = np.ascontiguousarray(places_m[row : row + len(ranges)])
        carved.add(at, rays.directions, ranges, BACK_OFF_M)
        hit = np.isfinite(ranges)
        ends += [p + rays.directions[h] * r[h, None] for p, r, h in zip(at, ranges, hit, strict=True)]
        row += len(ranges)
    whole = hall.index
    points, normals = hall.points_and_normals
    seen = np.isfinite(cKDTree(np.concatenate(ends)).query(points, distance_upper_bound=0.3)[0])
    inside = np.empty((0, 3))
    if hidden is not None:
        low, high = np.array(hidden[:3]), np.array(hidden[3:])
        seen &= ~((points > low) & (points < high)).all(axis=1)
        axes = [np.arange(a, b, 0.1) for a, b in zip(low, high, strict=True)]
        inside = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 3)
    points, normals = points[seen], normals[seen]
    surface = MapSurface.of(Surface(points, normals, np.ones(len(points), bool)), RegistrationConfig())
    brick, once, twice = carved.bricks()
    parts = merged([{"brick": brick, "once": once, "twice": twice}], 2)
    free = (
        seen_free(parts, np.concatenate([points, inside]), RegistrationConfig()) if with_seen_free else None
    )
    return replace(whole, surface=surface, view=MapView.of(points, 25.0), seen_free=free)
