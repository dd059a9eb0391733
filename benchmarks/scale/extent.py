"""Worlds of any size: campuses of different seeds side by side, or a square cut out of one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firstfix_builder.mesh.clip import clip_mesh
from firstfix_builder.mesh.mesh import Mesh
from firstfix_builder.simulation.worlds.campus import HALF_M, campus
from firstfix_builder.simulation.worlds.drive import drive
from firstfix_builder.simulation.worlds.write_world import ply_of_mesh

SEED = 7
CUT_BELOW_M = 1.0  # the drive of a cut-out ends so far before its edge


@dataclass(frozen=True)
class Extent:
    """Part of the joined campuses that a world covers.

    Attributes:
        side: campuses along x and along y.
        half_m: only what lies so near to the middle, along both axes; None: all.
        middle_m: of what is cut out of a single campus.
        spacing_m: of its templates.
        config: of the build, beside the sensor.
    """

    name: str
    side: int
    half_m: float | None = None
    middle_m: tuple[float, float] = (0.0, 0.0)
    spacing_m: float = 0.44
    config: Mapping[str, Any] = field(default_factory=dict)

    def write(self, folder: Path) -> None:
        """``mesh.ply`` and ``trajectory.txt`` (TUM), the same bytes every time."""
        meshes, drives = [], []
        for number in range(self.side**2):
            place = campus(np.random.default_rng([SEED, number]))
            shift = np.append(2 * HALF_M * (np.array(divmod(number, self.side)) - (self.side - 1) / 2), 0)
            mesh = place.mesh()
            meshes.append(Mesh(mesh.vertices + shift, mesh.triangles))
            drives.append(drive(place)[:, :3, 3] + shift)
        mesh, at = Mesh.joined(meshes), np.concatenate(drives)
        if self.half_m is not None:
            for axis, below in ((0, True), (0, False), (1, True), (1, False)):
                limit_m = self.middle_m[axis] + (self.half_m if below else -self.half_m)
                mesh = clip_mesh(mesh, axis, limit_m, below)
            at = at[np.abs(at[:, :2] - self.middle_m).max(axis=1) < self.half_m - CUT_BELOW_M]
        (folder / "mesh.ply").write_bytes(ply_of_mesh(mesh))
        (folder / "trajectory.txt").write_text(_tum(at))


def _tum(at: NDArray[np.float64]) -> str:
    """All headings alike: only where the floors are is read from it."""
    return "".join(f"{k} {x:.4f} {y:.4f} {z:.4f} 0 0 0 1\n" for k, (x, y, z) in enumerate(at))


EXTENTS = {
    "10k": Extent("10k", 1, 25.0),
    "100k": Extent("100k", 1),
    "1M": Extent("1M", 3),
}
_QUICKLY = {"self_test": {"queries": 12, "outside": 4}, "learn_keys": {"scans": 60}}
QUICK = {
    "small": Extent("small", 1, 11.0, (23.0, 23.0), 1.0, _QUICKLY),
    "larger": Extent("larger", 1, 15.0, (23.0, 23.0), 1.0, _QUICKLY),
}
