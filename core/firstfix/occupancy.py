"""The default engine's descriptor: which cells of the polar grid hold something, layer by layer.

Maximum height alone wastes an indoor scan: it sees the ceiling. Occupancy in several height layers
keeps what stands at every height, in bits. Its key is the magnitude of the first Fourier coefficients
of every ring (docs/method.md): turning the robot only shifts the phases, so the key stays the same.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .polar import PolarGrid


@dataclass(frozen=True)
class LayeredGrid:
    """A polar grid with height layers.

    Attributes:
        edges_m: layer boundaries above the floor, ascending: n + 1 edges make n layers; what is
            below the first (the floor itself) or above the last counts nowhere.
    """

    polar: PolarGrid
    edges_m: tuple[float, ...] = (0.3, 1.0, 1.8, 3.0, 6.0, 25.0)

    @property
    def layers(self) -> int:
        return len(self.edges_m) - 1

    @property
    def rows(self) -> int:
        """Layers times rings: one circular signal over the sectors each."""
        return self.layers * self.polar.rings


def occupancy(
    points: NDArray[np.float32],
    scan_of_point: NDArray[np.intp],
    scans: int,
    height_m: NDArray[np.float32],
    grid: LayeredGrid,
) -> NDArray[np.bool_]:
    """(p, 3) levelled points of a batch of scans to (scans, layers * rings, sectors).

    Args:
        scan_of_point: (p,) the scan each point belongs to.
        height_m: (scans,) of each sensor above its floor.
    """
    above = points[:, 2] + height_m[scan_of_point]
    layer = np.searchsorted(np.asarray(grid.edges_m, np.float32), above, side="right") - 1
    rows = np.flatnonzero((layer >= 0) & (layer < grid.layers))
    inside, cell = grid.polar.cells(points[rows, 0], points[rows, 1])
    rows = rows[inside]
    cells = grid.polar.rings * grid.polar.sectors
    filled = np.zeros(scans * grid.layers * cells, np.bool_)
    filled[(scan_of_point[rows] * grid.layers + layer[rows]) * cells + cell] = True
    return filled.reshape(scans, grid.rows, grid.polar.sectors)


def ring_spectrum(filled: NDArray[np.bool_], coefficients: int = 8) -> NDArray[np.float32]:
    """(n, rows, sectors) to the unit-length, rotation-invariant key (n, rows * coefficients).

    Coefficients past the mean count twice in the signal's energy (Parseval), hence the root of two.
    """
    spectrum = np.abs(np.fft.rfft(filled.astype(np.float32), axis=-1))[..., :coefficients].astype(np.float32)
    spectrum[..., 1:] *= np.float32(np.sqrt(2))
    key = spectrum.reshape(len(filled), -1)
    return key / np.maximum(np.linalg.norm(key, axis=1, keepdims=True), 1e-9)


def best_shifts(
    query: NDArray[np.bool_], templates: NDArray[np.uint8]
) -> tuple[NDArray[np.intp], NDArray[np.float32]]:
    """The turn at which each template explains the query best.

    Args:
        query: (rows, sectors).
        templates: (n, rows, sectors), 0 or 1.

    Returns:
        (n,) sectors s, and (n,) the cosine of query and template turned by it, 0..1: cell j of the
        query meets cell j + s of the template, so the query's frame stands at +s sectors of yaw in
        the template's.
    """
    sectors = query.shape[1]
    turned = np.stack([np.roll(query, s, axis=1).ravel() for s in range(sectors)]).astype(np.float32)
    stack = templates.reshape(len(templates), -1).astype(np.float32)
    overlap = stack @ turned.T  # (n, sectors)
    shift = overlap.argmax(axis=1)
    norm = np.sqrt(np.float32(query.sum()) * stack.sum(axis=1))
    score = overlap[np.arange(len(stack)), shift] / np.maximum(norm, np.float32(1))
    return shift, score
