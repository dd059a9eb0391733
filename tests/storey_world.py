"""A storey with three rooms that look alike, and a building of such storeys."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from firstfix.builds.config import PerturbConfig
from firstfix.scan.scan import Scan
from firstfix.sensor import SensorModel
from firstfix.transform import make_transform, rotation_z
from firstfix_builder.simulation.simulate import Simulator
from tests.small_world import SENSOR, SmallWorld

if TYPE_CHECKING:
    from firstfix_builder.job.build_job import BuildResult
    from tests.once_a_run import OnceARun

ROOMS_X = (0.0, 9.0, 22.0)  # of their middles: 9 m apart, and 13 m
SENSOR_Z = 0.8
STOREY_M = 3.4
CONFIG = {"sensor": SENSOR, "learn_keys": {"scans": 200}, "self_test": {"queries": 12, "outside": 6}}

WING_Y = 4.8  # of the wall between the two wings
Box = tuple[tuple[float, float, float], tuple[float, float, float]]  # middle, size


def storey() -> SmallWorld:
    """Returns rooms of 6 x 5 m with a door in the north to a walled corridor."""
    boxes: list[Box] = [((11, 3.6, -0.1), (32, 2.2, 0.2))]
    boxes += [
        ((11, 4.8, 1.4), (32, 0.2, 2.8)),
        ((-5, 3.6, 1.4), (0.2, 2.2, 2.8)),
        ((27, 3.6, 1.4), (0.2, 2.2, 2.8)),
    ]
    ends = [-5.0, *(edge for x in ROOMS_X for edge in (x - 3, x + 3)), 27.0]
    for left, right in zip(ends[::2], ends[1::2], strict=True):
        boxes.append((((left + right) / 2, 2.6, 1.4), (right - left, 0.2, 2.8)))
    for x in ROOMS_X:
        boxes += [((x + dx, dy, z), size) for (dx, dy, z), size in _room()]
    return mesh_of(boxes)


def building() -> SmallWorld:
    """Returns two storeys under a roof, each with its mirrored wing. A few rooms have a thing more."""
    one = storey()
    wing = SmallWorld(one.vertices * [1, -1, 1] + [0, 2 * WING_Y, 0], one.triangles[:, ::-1])
    roof: list[Box] = [((11, WING_Y, -0.1), (32.4, 2 * WING_Y + 5.4, 0.2))]
    own: list[Box] = [  # in four of the twelve rooms
        ((9.5, 1.6, 0.5), (1.4, 0.6, 1.0)),
        ((23.8, 1.2, STOREY_M + 0.9), (0.6, 1.2, 1.8)),
        ((1.6, 2 * WING_Y - 1.8, 0.4), (0.9, 0.9, 0.8)),
        ((8.2, 2 * WING_Y + 0.4, STOREY_M + 0.7), (0.5, 1.5, 1.4)),
    ]
    parts = [one, wing, raised(one), raised(wing), raised(mesh_of(roof), 2 * STOREY_M), mesh_of(own)]
    starts = np.cumsum([0, *(len(part.vertices) for part in parts)])
    triangles = [part.triangles + start for part, start in zip(parts, starts, strict=False)]
    return SmallWorld(np.concatenate([part.vertices for part in parts]), np.concatenate(triangles))


def raised(part: SmallWorld, by_m: float = STOREY_M) -> SmallWorld:
    return SmallWorld(part.vertices + [0, 0, by_m], part.triangles)


def storey_version(once_a_run: OnceARun) -> BuildResult:
    """Returns the storey's version, to be read only."""

    def write(folder: Path) -> Path:
        return storey().write(folder / "storey.ply")

    return once_a_run.version("storey", write, CONFIG)


def _room() -> list[Box]:
    """Returns floor, walls with a door 1 m wide, and furniture, around the room's centre."""
    return [
        ((0, 0, -0.1), (6.2, 5.2, 0.2)),
        ((0, -2.6, 1.4), (6.2, 0.2, 2.8)),
        ((-3, 0, 1.4), (0.2, 5.2, 2.8)),
        ((3, 0, 1.4), (0.2, 5.2, 2.8)),
        ((-0.75, 2.6, 1.4), (4.5, 0.2, 2.8)),
        ((2.75, 2.6, 1.4), (0.5, 0.2, 2.8)),
        ((-2.4, -1.2, 0.9), (0.8, 1.6, 1.8)),
        ((0.6, -2.2, 0.6), (1.8, 0.5, 1.2)),
        ((-2.5, 1.8, 0.5), (0.6, 0.9, 1.0)),
        ((2.5, -0.4, 0.7), (0.5, 1.0, 1.4)),
    ]


def mesh_of(boxes: list[Box]) -> SmallWorld:
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])
    vertices = np.concatenate([corners * size + middle for middle, size in boxes])
    return SmallWorld(vertices, np.concatenate([faces + 8 * n for n in range(len(boxes))]))


def pose(x: float, y: float, yaw_deg: float) -> NDArray[np.float64]:
    return make_transform(rotation_z(np.radians(yaw_deg)), [x, y, SENSOR_Z])


def scan_at(world: SmallWorld, T_map_sensor: NDArray[np.float64], seed: int) -> Scan:
    """Returns a scan of the small world's sensor, with noise and dropout."""
    sensor, rng = SensorModel.from_mapping(SENSOR), np.random.default_rng(seed)
    noise = PerturbConfig()
    simulator = Simulator(world.vertices, world.triangles)
    ranges = next(simulator.ranges(T_map_sensor[None], sensor))[0]
    ranges = ranges + rng.normal(0, noise.noise_m, ranges.shape)
    seen = np.isfinite(ranges) & (rng.random(ranges.shape) > noise.dropout)
    return Scan.from_points(sensor.directions()[seen] * ranges[seen, None])
