"""Two rooms. The mapping run drives through the left one, and sees the right one through a door."""

from __future__ import annotations

import numpy as np

from firstfix.engine.config import RegistrationConfig
from firstfix.engine.verification.seen_free import SeenFree
from firstfix.native import CarvedCells
from firstfix.sensor import preset
from firstfix_builder.index.carve import BACK_OFF_M, RAYS, merged, seen_free
from firstfix_builder.mesh.mesh import Mesh
from firstfix_builder.simulation.rays import Rays
from firstfix_builder.simulation.simulate import Simulator, upright
from tests.builder.box_scenes import box, floor, sampled, walls

SENSOR = preset("os0-64")
REGISTRATION = RegistrationConfig(map_voxel_m=0.125)
HEIGHT_M = 1.0
MESH = Mesh.joined(
    [
        floor(0, 0, 12, 6),
        floor(0, 0, 12, 6, z=3.0),  # the ceiling
        *walls(0, 0, 12, 6),
        box((5.95, 0, 0), (6.05, 0.6, 3)),  # the wall between them has a door from 0.6 to 1.6 m
        box((5.95, 1.6, 0), (6.05, 6, 3)),
    ]
)
DRIVE = np.column_stack([np.linspace(1, 4, 9), np.full(9, 4.0), np.full(9, HEIGHT_M)])


def simulator() -> Simulator:
    return Simulator(MESH.vertices, MESH.triangles)


def seen_from(places_m: np.ndarray) -> SeenFree:
    """Casts the rays of a mapping run through the places; returns the space that it saw free."""
    cells, rays = CarvedCells(0.1), Rays.at_any_heading(SENSOR.coarser(RAYS))
    start = 0
    for ranges in simulator().ranges(upright(places_m), SENSOR, rays):
        some = np.ascontiguousarray(places_m[start : start + len(ranges)])
        cells.add(some, rays.directions, ranges, BACK_OFF_M)
        start += len(ranges)
    brick, once, twice = cells.bricks()
    carved = merged([{"brick": brick, "once": once, "twice": twice}], 2)
    return seen_free(carved, sampled(MESH, 200), REGISTRATION)
