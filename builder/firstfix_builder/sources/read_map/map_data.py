"""A map as it was read: points or a mesh, where the sensor went, and the local origin."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from firstfix.bit_exact.sample import rows_by_chance
from firstfix.errors import MalformedData
from firstfix.formats.point_cloud import PointCloud
from firstfix.transform import make_transform

from ...mesh.bounds import in_all
from ...mesh.intensity import Intensity
from .what_was_read import WhatWasRead


@dataclass(frozen=True)
class MapData:
    """Either points or a mesh (vertices and triangles), the other None.

    Attributes:
        points: (n, 3) metres, finite.
        intensity: of the points; None: the source tells of none.
        vertices: (v, 3) metres, finite.
        triangles: (t, 3) rows of vertices.
        trajectory: (m, 4, 4) T_map_sensor, or None where the source tells of none.
        trajectory_source: ``given`` by the user beside the source, or of the source itself (``file``): such
            poses refuse no map. It says nothing where there is no trajectory.
        origin: (3,) what, added to a coordinate here, gives the source's coordinate.
        metres: in one unit of x and y, and of z, as the source says; ``scaled`` converts them.
        read: what the source is, and what of it was left out.
    """

    points: NDArray[np.float64] | None = None
    intensity: Intensity | None = None
    vertices: NDArray[np.float64] | None = None
    triangles: NDArray[np.int64] | None = None
    trajectory: NDArray[np.float64] | None = None
    trajectory_source: Literal["given", "file"] = "file"
    origin: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))
    metres: tuple[float, float] = (1.0, 1.0)
    read: WhatWasRead = field(default_factory=WhatWasRead)

    @property
    def coordinates(self) -> NDArray[np.float64]:
        """(k, 3) the points, or the vertices of the mesh."""
        coordinates = self.points if self.points is not None else self.vertices
        if coordinates is None:
            raise ValueError("a map has points or vertices")
        return coordinates

    @property
    def surface(self) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Vertices and triangles of a mesh."""
        if self.vertices is None or self.triangles is None:
            raise ValueError("the map is no mesh")
        return self.vertices, self.triangles


MAX_ABS_COORDINATE_M = 1e8  # no projection of the Earth goes further
LARGE_COORDINATE_M = 10_000.0
ORIGIN_STEP_M = 100.0
_SAMPLED_POINTS = 100_000

# LOAM's camera frame (x left, y up, z forward; glTF's as well) to REP-103: x forward, y left, z up.
_R_ZUP_YUP = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


def finite_points(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """The rows of (n, 3) that are finite and on this planet.

    Raises:
        MalformedData: there are none.
    """
    keep = finite_rows(points)
    return points if keep.all() else points[keep]


def finite_cloud(cloud: PointCloud) -> tuple[NDArray[np.float64], Intensity | None]:
    """The points (n, 3) of a file that are finite and on this planet, with their intensity.

    Raises:
        MalformedData: there are none.
    """
    points = cloud.xyz
    keep = finite_rows(points)
    return points if keep.all() else points[keep], Intensity.of(cloud.intensity, keep)


def finite_rows(points: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether each of (n, 3) points is finite and on this planet.

    Raises:
        MalformedData: none is.
    """
    with np.errstate(invalid="ignore"):
        keep = in_all(np.abs(points) <= MAX_ABS_COORDINATE_M)  # NaN compares false
    if not keep.any():
        raise MalformedData(f"none of its {len(points)} points has finite coordinates")
    return keep


def scaled(data: MapData, scale: float) -> MapData:
    """The map in metres.

    Args:
        scale: metres in one unit of the source, as the user says; 1: what the source says of itself counts.
    """
    across_m, up_m = data.metres if scale == 1.0 else (scale, scale)
    if (across_m, up_m) == (1.0, 1.0):
        return data
    by = np.array([across_m, across_m, up_m])
    trajectory = data.trajectory
    if trajectory is not None:
        trajectory = trajectory.copy()
        trajectory[:, :3, 3] *= by
    return replace(
        data,
        points=None if data.points is None else data.points * by,
        vertices=None if data.vertices is None else data.vertices * by,
        trajectory=trajectory,
        metres=(1.0, 1.0),
    )


def turn_z_up(data: MapData) -> MapData:
    """From y up, x left, z forward to z up, x forward, y left. Poses turn on both sides."""
    T_zup_yup = make_transform(_R_ZUP_YUP, np.zeros(3))
    return replace(
        data,
        points=None if data.points is None else data.points @ _R_ZUP_YUP.T,
        vertices=None if data.vertices is None else data.vertices @ _R_ZUP_YUP.T,
        trajectory=None if data.trajectory is None else T_zup_yup @ data.trajectory @ T_zup_yup.T,
    )


def local_origin(data: MapData) -> NDArray[np.float64]:
    """(3,) the local origin of a map with UTM-sized coordinates: a multiple of 100 m in x and y.

    The median decides, so that stray points do not. Within 10 km it is zero.
    """
    coordinates = data.coordinates
    sample = coordinates[rows_by_chance(len(coordinates), _SAMPLED_POINTS), :2]
    centre = np.median(sample, axis=0)
    if np.abs(centre).max() <= LARGE_COORDINATE_M:
        return np.zeros(3)
    return np.array([*(np.floor(centre / ORIGIN_STEP_M) * ORIGIN_STEP_M), 0.0])


def subtract_origin(data: MapData, origin: NDArray[np.float64]) -> MapData:
    """Move a map to a local origin."""
    if not origin.any():
        return data
    trajectory = data.trajectory
    if trajectory is not None:
        trajectory = trajectory.copy()
        trajectory[:, :3, 3] -= origin
    return replace(
        data,
        points=None if data.points is None else data.points - origin,
        vertices=None if data.vertices is None else data.vertices - origin,
        trajectory=trajectory,
        origin=data.origin + origin,
    )
