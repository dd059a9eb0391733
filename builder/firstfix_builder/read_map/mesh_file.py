"""Meshes through trimesh: PLY with faces, OBJ, STL, GLB."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from firstfix.errors import MalformedData

from .file_errors import foreign
from .local_frame import MAX_ABS_COORDINATE_M
from .map_data import MapData


def read_mesh(path: Path) -> MapData:
    """All parts of a scene as one mesh of triangles; equal vertices are merged.

    Raises:
        MalformedData: damaged, cut off, or without a triangle.
    """
    import trimesh

    with foreign(path.suffix[1:].upper()):
        scene = trimesh.load_scene(path, process=False, skip_materials=True)
        mesh = scene.to_mesh()
        mesh.merge_vertices(merge_tex=True, merge_norm=True)
        vertices = np.asarray(mesh.vertices, np.float64)
        triangles = np.asarray(mesh.faces, np.int64)
    return _checked(vertices, triangles)


def _checked(vertices: NDArray[np.float64], triangles: NDArray[np.int64]) -> MapData:
    if triangles.ndim != 2 or not len(triangles):
        raise MalformedData("the mesh has no triangle")
    if triangles.min() < 0 or triangles.max() >= len(vertices):
        raise MalformedData(f"a triangle names vertex {triangles.max()} of {len(vertices)}: cut off")
    with np.errstate(invalid="ignore"):
        good: NDArray[np.bool_] = np.all(np.abs(vertices) <= MAX_ABS_COORDINATE_M, axis=1)  # NaN: false
    triangles = triangles[good[triangles].all(axis=1)]
    if not len(triangles):
        raise MalformedData("none of the mesh's triangles has finite coordinates")
    used = np.unique(triangles)
    return MapData(vertices=vertices[used], triangles=np.searchsorted(used, triangles).astype(np.int64))
