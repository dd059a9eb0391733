"""A map as it was read: points or a mesh, where the sensor went, and the local origin."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class MapData:
    """Either points or a mesh (vertices and triangles), the other None.

    Attributes:
        points: (n, 3) metres, finite.
        vertices: (v, 3) metres, finite.
        triangles: (t, 3) rows of vertices.
        trajectory: (m, 4, 4) T_map_sensor, or None where the source tells of none.
        origin: (3,) what, added to a coordinate here, gives the source's coordinate.
    """

    points: NDArray[np.float64] | None = None
    vertices: NDArray[np.float64] | None = None
    triangles: NDArray[np.int64] | None = None
    trajectory: NDArray[np.float64] | None = None
    origin: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))

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
