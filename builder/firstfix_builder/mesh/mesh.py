"""A triangle mesh, as stages exchange it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

_F = TypeVar("_F", bound=np.floating)


@dataclass(frozen=True)
class Mesh:
    """A triangle mesh.

    Attributes:
        vertices: (v, 3) float64, metres, map frame.
        triangles: (t, 3) int64 indices, counter-clockwise as seen from free space where that is known.
    """

    vertices: NDArray[np.float64]
    triangles: NDArray[np.int64]

    @classmethod
    def empty(cls) -> Mesh:
        """A mesh without triangles."""
        return cls(np.zeros((0, 3)), np.zeros((0, 3), np.int64))

    @classmethod
    def joined(cls, meshes: Iterable[Mesh]) -> Mesh:
        """Join meshes, in their order."""
        parts = [mesh for mesh in meshes if len(mesh.triangles)]
        if not parts:
            return cls.empty()
        shift = np.cumsum([0] + [len(mesh.vertices) for mesh in parts[:-1]])
        triangles = [mesh.triangles + start for mesh, start in zip(parts, shift, strict=True)]
        return cls(np.concatenate([mesh.vertices for mesh in parts]), np.concatenate(triangles))

    def with_triangles(self, keep: NDArray[np.bool_]) -> Mesh:
        """Mesh of the (t,) kept triangles, without unused vertices."""
        triangles = self.triangles[keep]
        used = np.zeros(len(self.vertices), bool)
        used[triangles] = True
        number = np.cumsum(used) - 1
        return Mesh(self.vertices[used], number[triangles])

    def save(self, directory: Path) -> None:
        """Write ``vertices.npy`` and ``triangles.npy``."""
        directory.mkdir(parents=True, exist_ok=True)
        np.save(directory / "vertices.npy", self.vertices, allow_pickle=False)
        np.save(directory / "triangles.npy", self.triangles, allow_pickle=False)

    @classmethod
    def load(cls, directory: Path) -> Mesh:
        """Read the files of ``save``."""
        return cls(
            np.load(directory / "vertices.npy", allow_pickle=False),
            np.load(directory / "triangles.npy", allow_pickle=False),
        )


def lowest(corners: NDArray[_F]) -> NDArray[_F]:
    """(t, 3, k) corners of triangles to the (t, k) least of each coordinate.

    NumPy reduces such a short axis several times as slowly. The same goes for the functions below.
    """
    return np.minimum(np.minimum(corners[:, 0], corners[:, 1]), corners[:, 2])


def highest(corners: NDArray[_F]) -> NDArray[_F]:
    """(t, 3, k) corners of triangles to the (t, k) largest of each coordinate."""
    return np.maximum(np.maximum(corners[:, 0], corners[:, 1]), corners[:, 2])


def middle(corners: NDArray[_F]) -> NDArray[_F]:
    """(t, 3, k) corners of triangles to their (t, k) centres."""
    return (corners[:, 0] + corners[:, 1] + corners[:, 2]) / 3


def longest_edge(corners: NDArray[_F]) -> NDArray[_F]:
    """(t, 3, 3) corners of triangles to the (t,) longest edges of their boxes."""
    x, y, z = (highest(corners) - lowest(corners)).T
    return np.maximum(np.maximum(x, y), z)
