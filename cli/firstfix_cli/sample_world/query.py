"""Query scans: where the robot might be switched on later, and what it sees there by then."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from firstfix.scan.scan import Scan
from firstfix.sensor import SensorModel
from firstfix.transform import inverse, make_transform, rotation_between, rotation_z
from firstfix_builder.mesh.mesh import Mesh
from firstfix_builder.simulation.simulate import Simulator

from .place import Place
from .primitives import placed
from .props import person
from .survey import Survey, measure

ASIDE_M = (0.3, 1.8)  # of the drive
CLEARANCE_M = 0.45
MAX_STEP_M = 0.35  # between the floor below the drive and the floor below the query
TILT_DEG = 2.0
HEIGHT_M = 0.03
PEOPLE = (3, 9)
PEOPLE_M = (1.2, 14.0)
TRIES = 200


@dataclass(frozen=True)
class WorldQuery:
    """A scan and where it was taken.

    Attributes:
        scan: at the sensor's full resolution, in its frame.
        T_map_sensor: (4, 4) in the frame of the map cloud, or None: not in this map.
    """

    scan: Scan
    T_map_sensor: NDArray[np.float64] | None


def queries(place: Place, survey: Survey, count: int, rng: np.random.Generator) -> list[WorldQuery]:
    """Scans near the drive, spread evenly along it, in a place that has changed and has people in it."""
    world = ChangedWorld(place, rng)
    found = []
    for stretch in np.array_split(np.arange(len(survey.T_world_sensor)), count):
        k, T_world_query = world.find_pose(survey.T_world_sensor, stretch, rng)
        scan = world.scan_at(T_world_query, rng)
        # the drift of the nearest mapping pose is the local error of the map
        T_map_world = survey.T_map_sensor[k] @ inverse(survey.T_world_sensor[k])
        found.append(WorldQuery(scan, T_map_world @ T_world_query))
    return found


def foreign_scan(
    place: Place, drive: NDArray[np.float64], sensor: SensorModel, rng: np.random.Generator
) -> WorldQuery:
    """A scan of another place, taken with this one's sensor."""
    world = ChangedWorld(place, rng, sensor)
    _, T_world_query = world.find_pose(drive, np.arange(len(drive)), rng)
    return WorldQuery(world.scan_at(T_world_query, rng), None)


class ChangedWorld:
    """A place on another day, scanned from poses beside the drive."""

    def __init__(self, place: Place, rng: np.random.Generator, sensor: SensorModel | None = None) -> None:
        self.sensor = sensor or place.sensor
        mesh = place.changed_mesh(rng)
        self.simulator = Simulator(mesh.vertices, mesh.triangles)

    def find_pose(
        self, drive: NDArray[np.float64], stretch: NDArray[np.intp], rng: np.random.Generator
    ) -> tuple[int, NDArray[np.float64]]:
        """Index of the nearest pose of the drive and a free pose (4, 4) beside the stretch."""
        for _ in range(TRIES):
            start = drive[rng.choice(stretch)]
            angle, aside = rng.uniform(0, 2 * np.pi), rng.uniform(*ASIDE_M)
            offset = aside * np.array([np.cos(angle), np.sin(angle), 0.0])
            sight = self.simulator.cast(start[None, :3, 3], offset[None] / aside)[0]
            if sight < aside + CLEARANCE_M:  # a wall between: not reachable from here
                continue
            T = self._upright(start[:3, 3], offset, rng)
            if T is None or self.simulator.distance(T[None, :3, 3])[0] < CLEARANCE_M:
                continue
            away = np.linalg.norm(drive[:, :3, 3] - T[:3, 3], axis=1)
            if away.min() >= ASIDE_M[0]:
                return int(np.argmin(away)), T
        raise RuntimeError("no free pose beside this stretch of the drive")

    def _upright(
        self, start: NDArray[np.float64], offset: NDArray[np.float64], rng: np.random.Generator
    ) -> NDArray[np.float64] | None:
        """A pose on the floor beside start, leaning as the floor does and a little more, any heading."""
        feet = start + offset + 0.2 * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]])
        down = self.simulator.cast(np.vstack([start, feet]), np.tile([0.0, 0.0, -1.0], (6, 1))).astype(float)
        if not np.isfinite(down).all() or np.ptp(down[1:]) > 0.15 or abs(down[1] - down[0]) > MAX_STEP_M:
            return None  # an edge, a stair or furniture below
        if abs(down[1] - self.sensor.mount_height_m) > 2 * MAX_STEP_M:
            return None
        floor = feet[0] - [0, 0, down[1]]
        normal = np.array([(down[2] - down[4]) / 0.4, (down[3] - down[5]) / 0.4, 1.0])
        lean = np.tan(np.radians(rng.uniform(-TILT_DEG, TILT_DEG, 2)) / np.sqrt(2))
        R = rotation_between([0, 0, 1], normal + np.append(lean, 0.0)) @ rotation_z(
            rng.uniform(-np.pi, np.pi)
        )
        height = self.sensor.mount_height_m + rng.uniform(-HEIGHT_M, HEIGHT_M)
        return make_transform(R, floor + R[:, 2] * height)

    def scan_at(self, T: NDArray[np.float64], rng: np.random.Generator) -> Scan:
        """Take a scan at T (4, 4) in the changed place, with passers-by, noise and dropout."""
        ranges = next(self.simulator.ranges(T[None], self.sensor))[0]
        people = self._people_around(T, rng)
        if len(people.triangles):
            crowd = Simulator(people.vertices, people.triangles)
            ranges = np.minimum(ranges, next(crowd.ranges(T[None], self.sensor))[0])
        return Scan.from_points(measure(ranges, self.sensor, rng))

    def _people_around(self, T: NDArray[np.float64], rng: np.random.Generator) -> Mesh:
        """Some people on the floor in sight of the sensor."""
        crowd = []
        for _ in range(int(rng.integers(*PEOPLE))):
            angle, away = rng.uniform(0, 2 * np.pi), rng.uniform(*PEOPLE_M)
            there = np.array([np.cos(angle), np.sin(angle), 0.0])
            sight = self.simulator.cast(T[None, :3, 3], there[None])[0]
            if sight < away + 0.3:
                continue
            spot = T[:3, 3] + there * away
            drop = float(self.simulator.cast(spot[None], np.array([[0.0, 0.0, -1.0]]))[0])
            if np.isfinite(drop) and drop > 0.5:  # less is a table top
                crowd.append(
                    placed(person(rng), spot[0], spot[1], spot[2] - drop, rng.uniform(-np.pi, np.pi))
                )
        return Mesh.joined(crowd)
