"""Writes the cloud of a map for viewers, with the templates and the mapping run."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from firstfix.engine.config import RegistrationConfig
from firstfix.engine.registration.align import MapSurface
from firstfix.transform import Matrix, transform_points

from .cloud_octree import AT_ONCE, CloudOctree, octahedral


def draw_cloud(
    out: Path,
    points: NDArray[np.floating],
    positions: NDArray[np.floating],
    trajectory: NDArray[np.float64] | None,
    index: Path,
    registration: RegistrationConfig,
    T_map_level: Matrix,
) -> None:
    """Writes an octree in the map's own frame, as ``cloud.json`` and ``cloud.bin``.

    Args:
        points: (n, 3) in the index's frame; may lie in a file.
        positions: (k, 3) of the templates.
        trajectory: (p, 4, 4) poses of the mapping run, if there are any.
        index: folder with the files of the surface, which the normals are taken from.
    """
    run = np.zeros((0, 3)) if trajectory is None else trajectory[:, :3, 3]
    marks = {"templates": positions, "trajectory": run}
    moved = {name: transform_points(T_map_level, mark) for name, mark in marks.items()}
    normals = _normals_at(points, index, registration, T_map_level)
    CloudOctree.of(points, normals, moved, T_map_points=T_map_level).save(out)


def _normals_at(
    points: NDArray[np.floating], index: Path, registration: RegistrationConfig, T_map_level: Matrix
) -> NDArray[np.int8]:
    """(n, 2) normals of the surface near the points, in the map's frame, as ``octahedral`` gives them."""
    grid = MapSurface.load(index, registration).fine
    found = np.empty((len(points), 2), np.int8)
    for first in range(0, len(points), AT_ONCE):
        part = slice(first, first + AT_ONCE)
        row = grid.nearest(np.ascontiguousarray(points[part] - grid.corner, np.float32))
        normals = np.zeros((len(row), 3))
        normals[row >= 0] = grid.planes[row[row >= 0], :3]
        found[part] = octahedral(normals @ T_map_level[:3, :3].T)
    return found
