"""Bare halls of boxes that are the same when they are turned, or have equal rooms or aisles."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from firstfix_builder.mesh.mesh import Mesh
from firstfix_builder.simulation.boxes import Boxes
from firstfix_builder.simulation.simulate import Simulator
from firstfix_cli.sample_world.write_world import ply_of_mesh

_Block = tuple[tuple[float, float, float], tuple[float, float, float]]  # lowest and highest corner, metres
SENSOR = {
    "name": "sixteen rings",
    "elevations_deg": [float(v) for v in np.linspace(-15, 15, 16)],
    "azimuth_step_deg": 0.6,
    "min_range_m": 0.3,
    "max_range_m": 60.0,
    "mount_height_m": 1.0,
}


@dataclass(frozen=True)
class Hall:
    """One hall.

    Attributes:
        blocks: its walls and things.
        symmetries: turns about a vertical axis, (degrees, x, y), after which it is the same.
    """

    blocks: tuple[_Block, ...]
    symmetries: tuple[tuple[float, float, float], ...] = ()

    @property
    def mesh(self) -> Mesh:
        """Its surface, floor and ceiling included."""
        low, high = (np.array([block[end] for block in self.blocks]) for end in (0, 1))
        vertices, triangles = Boxes((low + high) / 2, (high - low) / 2, np.zeros(len(low))).mesh()
        return Mesh(vertices, triangles)

    @property
    def simulator(self) -> Simulator:
        mesh = self.mesh
        return Simulator(mesh.vertices, mesh.triangles)

    def write(self, path: Path) -> Path:
        """Write the surface as a PLY file."""
        path.write_bytes(ply_of_mesh(self.mesh))
        return path


def _shell(x: float, y: float, height: float) -> list[_Block]:
    return [
        ((0, 0, -0.2), (x, y, 0)),
        ((0, 0, height), (x, y, height + 0.2)),
        ((0, -0.2, 0), (x, 0, height)),
        ((0, y, 0), (x, y + 0.2, height)),
        ((-0.2, 0, 0), (0, y, height)),
        ((x, 0, 0), (x + 0.2, y, height)),
    ]


def _columns(xs: tuple[float, ...], ys: tuple[float, ...]) -> list[_Block]:
    return [((x - 0.3, y - 0.3, 0), (x + 0.3, y + 0.3, 4)) for x in xs for y in ys]


def shed() -> Hall:
    """A hall of 40 x 12 m with eight columns: the same after half a turn."""
    blocks = [*_shell(40, 12, 4), *_columns((6, 14, 26, 34), (3, 9))]
    return Hall(tuple(blocks), ((180, 20, 6),))


def square() -> Hall:
    """A hall of 18 x 18 m with four columns: the same after each quarter turn."""
    blocks = [*_shell(18, 18, 4), *_columns((5, 13), (5, 13))]
    return Hall(tuple(blocks), ((90, 9, 9), (180, 9, 9), (270, 9, 9)))


def aisles() -> Hall:
    """A warehouse of 36 x 24 m with fifteen equal racks."""
    racks: list[_Block] = [
        ((x, y, 0), (x + 7, y + 1.4, 4)) for x in (4, 14.5, 25) for y in (3, 7.4, 11.3, 15.2, 19.6)
    ]
    return Hall((*_shell(36, 24, 6), *racks), ((180, 18, 12),))


def rooms() -> Hall:
    """A corridor of 36 x 2 m with six rooms at each side, each with the same desk and cupboard."""
    blocks: list[_Block] = [
        ((-0.2, -5.2, -0.2), (36.2, 7.2, 0)),
        ((-0.2, -5.2, 2.8), (36.2, 7.2, 3)),
        ((-0.2, -5.2, 0), (0, 7.2, 2.8)),
        ((36, -5.2, 0), (36.2, 7.2, 2.8)),
        ((0, -5.2, 0), (36, -5, 2.8)),
        ((0, 7, 0), (36, 7.2, 2.8)),
    ]
    for x in range(0, 36, 6):
        for low, high in ((-0.1, 0.0), (2.0, 2.1)):  # the walls of the corridor, with doors of a metre
            blocks += [((x, low, 0), (x + 3.5, high, 2.8)), ((x + 4.5, low, 0), (x + 6, high, 2.8))]
        if x:
            blocks += [((x - 0.05, -5, 0), (x + 0.05, -0.1, 2.8)), ((x - 0.05, 2.1, 0), (x + 0.05, 7, 2.8))]
        blocks += [((x + 0.6, -4.6, 0), (x + 2.2, -3.8, 0.8)), ((x + 5.2, -3.2, 0), (x + 5.8, -1.8, 1.9))]
        blocks += [((x + 0.6, 5.8, 0), (x + 2.2, 6.6, 0.8)), ((x + 5.2, 3.8, 0), (x + 5.8, 5.2, 1.9))]
    return Hall(tuple(blocks))


HALLS: dict[str, Callable[[], Hall]] = {"shed": shed, "square": square, "aisles": aisles, "rooms": rooms}
