"""Meshes through trimesh: PLY with faces, OBJ, STL, GLB."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from firstfix.errors import MalformedData
from firstfix.formats.point_cloud import MAP_LIMITS

from .file_errors import foreign
from .headers import check_glb
from .map_data import MAX_ABS_COORDINATE_M, MapData


def read_mesh(path: Path) -> MapData:
    """All parts of a scene as one mesh of triangles; equal vertices are merged.

    Raises:
        MalformedData: damaged, cut off, or without a triangle.
        TooLarge: over the limits.
    """
    import trimesh

    ending = path.suffix[1:].upper()
    if ending == "GLB":
        check_glb(path)
    with foreign(ending, path):
        scene = trimesh.load_scene(path, process=False, skip_materials=True)
        placed = (scene.geometry[scene.graph[node][1]] for node in scene.graph.nodes_geometry)
        # A few bytes place a part of a scene once more.
        MAP_LIMITS.check(ending, sum(len(getattr(part, "faces", ())) for part in placed), 8 * 3)
        points = sum(len(part.vertices) for part in scene.geometry.values() if _is_cloud(part))
        mesh = scene.to_mesh()
        vertices = np.asarray(mesh.vertices, np.float64)
        triangles = np.asarray(mesh.faces, np.int64)
    if points and not len(triangles):
        raise MalformedData(
            f"{points} points and no triangle: a cloud in a file for meshes: save it as PLY or PCD"
        )
    return _merged(*_checked(vertices, triangles))


def _is_cloud(part: object) -> bool:
    return not hasattr(part, "faces") and not hasattr(part, "entities")


def _checked(
    vertices: NDArray[np.float64], triangles: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """The triangles whose corners are there and finite."""
    if triangles.ndim != 2 or not len(triangles):
        raise MalformedData("the mesh has no triangle")
    if triangles.min() < 0 or triangles.max() >= len(vertices):
        raise MalformedData(f"a triangle has a vertex beyond the {len(vertices)} of the file")
    good: NDArray[np.bool_] = np.all(np.abs(vertices) <= MAX_ABS_COORDINATE_M, axis=1)  # NaN compares false
    triangles = triangles[good[triangles].all(axis=1)]
    if not len(triangles):
        raise MalformedData("none of the mesh's triangles has finite coordinates")
    return vertices, triangles


def _merged(vertices: NDArray[np.float64], triangles: NDArray[np.int64]) -> MapData:
    """Without the vertices that no triangle uses, and with equal ones (STL repeats them) made one."""
    used, corners = np.unique(triangles, return_inverse=True)
    unique, places = np.unique(vertices[used] + 0.0, axis=0, return_inverse=True)  # + 0.0: -0.0 is 0.0
    return MapData(vertices=unique, triangles=places.ravel()[corners].reshape(-1, 3).astype(np.int64))
