"""Templates of office floors that nobody built maps of, and scans taken there on another day."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from firstfix.descriptor import LayeredOccupancy, PolarGrid
from firstfix.engine.config import OccupancyConfig
from firstfix.engine.map_choice.coarse_templates import CoarseTemplates
from firstfix.scan.scan import Scan
from firstfix_builder.simulation.rays import Rays
from firstfix_builder.simulation.simulate import Simulator
from firstfix_cli.sample_world.drive import drive
from firstfix_cli.sample_world.query import ChangedWorld

from ...worlds.office import office

SPACING_M = 0.5
NEAR_DRIVE_M = 2.5
FREE_M = 0.3
MAX_RAYS = 8192
RANGE_M = 10.0
SCANS = 2
FLOOR_M = 0.1


@dataclass(frozen=True)
class Floor:
    """The ground floor of an office building.

    Attributes:
        templates: 0.5 m apart, of clean scans. The mesh is the true one: a build reconstructs it.
        scans: at poses between them, any heading and up to 2 degrees of tilt, with noise, dropout and people,
            after two fifths of what can move was moved or taken away.
    """

    templates: CoarseTemplates
    scans: list[Scan]


def make_floor(seed: int) -> Floor:
    """Another seed gives another building of the same architect: rooms, doors and furniture differ."""
    rng = np.random.default_rng([seed, 0, 0])
    place = office(rng)
    mesh, sensor = place.mesh(), place.sensor
    simulator = Simulator(mesh.vertices, mesh.triangles)
    poses = drive(place)
    poses = poses[np.abs(poses[:, 2, 3] - sensor.mount_height_m) < FLOOR_M / 2]
    positions = _standing_places(simulator, poses[:, :3, 3], sensor.mount_height_m)
    config = OccupancyConfig(max_range_m=RANGE_M)
    descriptor = LayeredOccupancy(PolarGrid(config.rings, config.sectors, RANGE_M))
    coarser, heights = sensor.coarser(MAX_RAYS), np.full(len(positions), sensor.mount_height_m)
    rays = Rays.at_any_heading(coarser)
    occupancy = simulator.occupied_cells(positions, heights, coarser, rays, descriptor)
    world, every = ChangedWorld(place, rng), np.arange(len(poses))
    scans = [world.scan_at(world.find_pose(poses, every, rng)[1], rng) for _ in range(SCANS)]
    return Floor(CoarseTemplates.of(config, positions, {"occupancy": occupancy}), scans)


def _standing_places(
    simulator: Simulator, driven: NDArray[np.float64], height_m: float
) -> NDArray[np.float64]:
    """(n, 3) places of a grid, near the drive, on the floor and clear of things."""
    low, high = driven[:, :2].min(axis=0) - 2, driven[:, :2].max(axis=0) + 2
    x, y = np.meshgrid(*(np.arange(a, b, SPACING_M) for a, b in zip(low, high, strict=True)))
    places = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, height_m)])
    away = np.linalg.norm(places[:, None, :2] - driven[None, ::2, :2], axis=2).min(axis=1)
    places = places[away < NEAR_DRIVE_M]
    down = simulator.cast(places, np.tile([0.0, 0.0, -1.0], (len(places), 1)))
    on_floor = np.abs(down - height_m) < FLOOR_M
    return places[simulator.is_free(places, FREE_M) & on_floor]
