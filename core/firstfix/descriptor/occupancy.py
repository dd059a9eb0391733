"""Layered occupancy, the default descriptor: filled cells of a polar grid in height layers, one bit each.

The maximum height alone wastes an indoor scan: it is the ceiling's. Several layers keep what stands at each
height. The key is the magnitude of the first Fourier coefficients of every ring (docs/method.md section 3):
when the robot turns only the phases shift, so the key stays the same.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ..bit_exact.accelerated import accelerated
from .base import Described
from .polar import PolarGrid
from .scan_batch import ScanBatch


@dataclass(frozen=True)
class LayeredOccupancy:
    """Occupancy of a polar grid with height layers.

    Attributes:
        edges_m: layer boundaries above the floor, ascending: n + 1 edges make n layers. Points below the
            first edge (the floor itself) or above the last are in no layer.
        coefficients: number that the key keeps of every ring's spectrum.
    """

    arrays: ClassVar[tuple[str, ...]] = ("occupancy",)

    grid: PolarGrid
    edges_m: tuple[float, ...] = (0.3, 1.0, 1.8, 3.0, 6.0, 25.0)
    coefficients: int = 8

    @property
    def rows(self) -> int:
        """Number of circular signals over the sectors: layers times rings."""
        return (len(self.edges_m) - 1) * self.grid.rings

    def describe(self, scans: ScanBatch) -> Described:
        """``occupancy``: (n, ceil(rows * sectors / 8)) uint8, packed bits (docs/method.md 3.1)."""
        grid, edges_m = self.grid, np.asarray(self.edges_m, np.float32)
        start = np.asarray(scans.start, np.int64)
        occupancy = occupied_cells(
            scans.points, start, scans.height_m, grid.rings, grid.sectors, grid.max_range_m, edges_m
        )
        return {"occupancy": occupancy}

    def filled(self, described: Described) -> NDArray[np.uint8]:
        """Unpacked occupancy: (n, rows, sectors), 0 or 1."""
        return _unpacked(described["occupancy"], self.rows, self.grid.sectors)

    def keys(self, described: Described) -> NDArray[np.float32]:
        """Ring spectra, (n, rows * coefficients), of unit length."""
        return ring_spectra(described["occupancy"], self.rows, self.grid.sectors, self.coefficients)

    def similarity(self, x: Described, y: Described) -> NDArray[np.float32]:
        """Cosines (n, m) of the occupied cells, without turning."""
        a, b = (self.filled(d).reshape(-1, self.rows * self.grid.sectors).astype(np.float32) for d in (x, y))
        alike: NDArray[np.float32] = a @ b.T
        alike /= np.maximum(np.sqrt(np.outer(a.sum(axis=1), b.sum(axis=1))), 1)
        return alike

    def match(
        self, query: Described, templates: Described, rows: NDArray[np.integer]
    ) -> tuple[NDArray[np.floating], NDArray[np.float32]]:
        """Find the yaw at which each of (k,) templates resembles the query most (docs/method.md 3.3)."""
        asked, known, sectors = query["occupancy"][0], templates["occupancy"], self.grid.sectors
        shift, score = best_shifts(asked, known, np.asarray(rows, np.int64), self.rows, sectors)
        return shift * (2 * np.pi / sectors), score


@accelerated
def occupied_cells(
    points: NDArray[np.float32],
    start: NDArray[np.int64],
    height_m: NDArray[np.float32],
    rings: int,
    sectors: int,
    max_range_m: float,
    edges_m: NDArray[np.float32],
) -> NDArray[np.uint8]:
    """Packed bits of the occupied cells of n scans: (n, ceil(layers * rings * sectors / 8)).

    Args:
        points: (p, 3) of all scans, levelled.
        start: (n + 1,) scan i holds ``points[start[i]:start[i + 1]]``.
        height_m: (n,) of the sensors above their floors.
        edges_m: (layers + 1,) ascending.
    """
    grid = PolarGrid(rings, sectors, max_range_m)
    scans = ScanBatch(points, start, height_m)
    of_point = scans.scan_of_point
    above = points[:, 2] + height_m[of_point]
    layers = len(edges_m) - 1
    layer = np.searchsorted(edges_m, above, side="right") - 1
    rows = np.flatnonzero((layer >= 0) & (layer < layers))
    inside, cell = grid.cells_of(points[rows, 0], points[rows, 1])
    rows = rows[inside]
    filled = np.zeros(len(scans) * layers * grid.cells, np.bool_)
    filled[(of_point[rows] * layers + layer[rows]) * grid.cells + cell] = True
    return np.packbits(filled.reshape(len(scans), layers * grid.cells), axis=1)


@accelerated
def ring_spectra(
    occupancy: NDArray[np.uint8], rings: int, sectors: int, coefficients: int
) -> NDArray[np.float32]:
    """Keys of n scans, of unit length: (n, rings * coefficients), or fewer if a ring's spectrum has fewer.

    Coefficients after the first count twice in the signal's energy (Parseval), hence the root of two.

    Args:
        occupancy: (n, bytes) packed bits.
        rings: of all layers.
        coefficients: number that is kept of every ring's spectrum.
    """
    signal = _unpacked(occupancy, rings, sectors).astype(np.float32)
    spectrum = np.abs(np.fft.rfft(signal, axis=-1))[..., :coefficients].astype(np.float32)
    spectrum[..., 1:] *= np.float32(np.sqrt(2))
    key = spectrum.reshape(len(signal), rings * spectrum.shape[2])
    key /= np.maximum(np.linalg.norm(key, axis=1, keepdims=True), 1e-9)
    return key


@accelerated
def best_shifts(
    query: NDArray[np.uint8],
    templates: NDArray[np.uint8],
    rows: NDArray[np.int64],
    rings: int,
    sectors: int,
) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
    """Compare one occupancy with m templates at every shift of the sectors.

    Args:
        query: (bytes,) packed bits.
        templates: (n, bytes) packed bits.
        rows: (m,) of the templates that are compared.
        rings: of all layers.

    Returns:
        (m,) shift s with the most shared cells, the smallest of equally good ones: sector j of the query lies
        on sector j + s of the template; (m,) score, the cosine of the cells there.
    """
    asked = _unpacked(query[None], rings, sectors)[0]
    stack = _unpacked(templates[rows], rings, sectors)
    norm = np.sqrt(np.float32(asked.sum()) * stack.sum(axis=(1, 2), dtype=np.float32))
    used = np.flatnonzero(asked.any(axis=1))  # empty rings match nothing at any yaw
    sector = np.arange(sectors)
    turned = asked[used][:, (sector - sector[:, None]) % sectors]  # (rings, turns, sectors)
    turned = turned.transpose(1, 0, 2).reshape(sectors, len(used) * sectors)
    common = stack[:, used].reshape(len(stack), len(used) * sectors).astype(np.float32)
    shared = common @ turned.T.astype(np.float32)
    shift = shared.argmax(axis=1)
    score = shared[np.arange(len(stack)), shift] / np.maximum(norm, np.float32(1))
    return shift, score


def _unpacked(occupancy: NDArray[np.uint8], rings: int, sectors: int) -> NDArray[np.uint8]:
    bits = np.unpackbits(occupancy, axis=1, count=rings * sectors)
    return bits.reshape(-1, rings, sectors)
