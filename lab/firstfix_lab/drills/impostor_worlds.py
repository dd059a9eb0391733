"""Worlds of places that look alike, mapped without a trajectory, and scans taken there in motion."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firstfix.builds.config import BuildConfig, PerturbConfig
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer
from firstfix.scan.scan import Scan
from firstfix.sensor import SensorModel
from firstfix.transform import Matrix, transform_points
from firstfix_builder.pipeline import build_version
from firstfix_builder.simulation.moving import Motion, Sweep
from firstfix_builder.simulation.perturb import ScanSimulation
from firstfix_builder.simulation.simulate import Simulator
from firstfix_cli.sample_world.make_world import OTHER_SEED
from firstfix_cli.sample_world.write_world import ply_of_cloud
from tests.needs import RECORDED
from tests.storey_world import CONFIG, building

from ..worlds.make_world import make_world, place_of

HOSPITAL = RECORDED / "worlds/hospital_aws_1floor.ply"
MOTIONS = ("straight", "turning", "both")
FASTEST_M_S, FASTEST_DEG_S = 1.5, 120.0
PEOPLE = PerturbConfig(strangers=0)  # passers-by, noise and lost returns


@dataclass(frozen=True)
class ImpostorWorld:
    """A map of places that look alike.

    Attributes:
        localizer: of its version.
        simulation: of scans in the map's frame, as the place is when they are taken.
    """

    localizer: Localizer
    simulation: ScanSimulation

    def scans(self, motion: str, count: int, rng: np.random.Generator) -> Iterator[tuple[Scan, Matrix]]:
        """Scan with times from anywhere in the map, each with T_map_sensor at its stamp."""
        index = self.localizer.index
        at_m = transform_points(index.T_map_level, index.cascade.templates.position_m.astype(np.float64))
        for case in self.simulation.cases(at_m, index.config.spacing_m, count, rng):
            yield self.simulation.scan(case, motion_of(motion, rng)), case.T_level_sensor


def motion_of(kind: str, rng: np.random.Generator) -> Motion:
    """A robot's motion on its floor. The stamp is at the begin or in the middle of the revolution.

    Args:
        kind: one of MOTIONS.
    """
    speed_m_s, heading = rng.uniform(0, FASTEST_M_S), rng.uniform(-np.pi, np.pi)
    turn_rad_s = np.radians(rng.uniform(-FASTEST_DEG_S, FASTEST_DEG_S))
    x, y = (0.0, 0.0) if kind == "turning" else (speed_m_s * np.cos(heading), speed_m_s * np.sin(heading))
    turn = 0.0 if kind == "straight" else turn_rad_s
    sweep = Sweep(stamp=float(rng.choice([0.0, 0.5])))
    return Motion((float(x), float(y), 0.0, 0.0, 0.0, float(turn)), sweep)


def office(seed: int) -> ImpostorWorld:
    """Two storeys of one plan, furnished apart. Things have moved since the map was made."""
    world = make_world("office", seed=seed)
    later = place_of("office", seed).changed_mesh(np.random.default_rng([seed, OTHER_SEED]))
    config = {"sensor": world.sensor.to_mapping()}
    return _built(ply_of_cloud(world.cloud), config, later.vertices, later.triangles)


def hospital() -> ImpostorWorld:
    """Wards along corridors, with the same furniture in many."""
    import trimesh

    mesh = trimesh.load(HOSPITAL)
    return _built(HOSPITAL.read_bytes(), {"sensor": "vlp-16"}, mesh.vertices, mesh.faces)


def storeys() -> ImpostorWorld:
    """Rooms that are equal, in two storeys and their mirrored wings."""
    world = building()
    with tempfile.TemporaryDirectory() as name:
        data = world.write(Path(name) / "map.ply").read_bytes()
    return _built(data, CONFIG, world.vertices, world.triangles)


def _built(
    data: bytes, config: Mapping[str, Any], vertices: NDArray[np.floating], triangles: NDArray[np.integer]
) -> ImpostorWorld:
    """The world of a map file. Its version is read whole, so that nothing is left on disk."""
    parsed = BuildConfig.parse(config)
    with tempfile.TemporaryDirectory() as name:
        source = Path(name) / "map.ply"
        source.write_bytes(data)
        built = build_version(source, parsed, Path(name) / "work")
        localizer = Localizer(MapIndex.load(built.directory), explains=False)
    sensor: SensorModel = parsed.sensor_model
    return ImpostorWorld(localizer, ScanSimulation(Simulator(vertices, triangles), sensor, PEOPLE))
