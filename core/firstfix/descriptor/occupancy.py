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
        """Returns ``occupancy``: (n, ceil(rows * sectors / 8)) uint8, packed bits (docs/method.md 3.1)."""
        above = scans.points[:, 2] + scans.height_m[scans.scan_of_point]
        layers = len(self.edges_m) - 1
        layer = np.searchsorted(np.asarray(self.edges_m, np.float32), above, side="right") - 1
        rows = np.flatnonzero((layer >= 0) & (layer < layers))
        inside, cell = self.grid.cells_of(scans.points[rows, 0], scans.points[rows, 1])
        rows = rows[inside]
        filled = np.zeros(len(scans) * layers * self.grid.cells, np.bool_)
        filled[(scans.scan_of_point[rows] * layers + layer[rows]) * self.grid.cells + cell] = True
        return {"occupancy": np.packbits(filled.reshape(len(scans), -1), axis=1)}

    def filled(self, described: Described) -> NDArray[np.uint8]:
        """Unpacked occupancy: (n, rows, sectors), 0 or 1."""
        bits = np.unpackbits(described["occupancy"], axis=1, count=self.rows * self.grid.sectors)
        return bits.reshape(-1, self.rows, self.grid.sectors)

    def keys(self, described: Described) -> NDArray[np.float32]:
        """Ring spectra, (n, rows * coefficients), of unit length.

        Coefficients after the first count twice in the signal's energy (Parseval), hence the root of two.
        """
        signal = self.filled(described).astype(np.float32)
        spectrum = np.abs(np.fft.rfft(signal, axis=-1))[..., : self.coefficients].astype(np.float32)
        spectrum[..., 1:] *= np.float32(np.sqrt(2))
        key = spectrum.reshape(len(signal), -1)
        key /= np.maximum(np.linalg.norm(key, axis=1, keepdims=True), 1e-9)
        return key

    def similarity(self, x: Described, y: Described) -> NDArray[np.float32]:
        """Cosines (n, m) of the occupied cells, without turning."""
        a, b = (self.filled(d).reshape(-1, self.rows * self.grid.sectors).astype(np.float32) for d in (x, y))
        alike: NDArray[np.float32] = a @ b.T
        alike /= np.maximum(np.sqrt(np.outer(a.sum(axis=1), b.sum(axis=1))), 1)
        return alike

    def match(
        self, query: Described, templates: Described
    ) -> tuple[NDArray[np.floating], NDArray[np.float32]]:
        """Finds the yaw at which each template resembles the query most (docs/method.md 3.3)."""
        asked, stack = self.filled(query)[0], self.filled(templates)
        sectors = self.grid.sectors
        norm = np.sqrt(np.float32(asked.sum()) * stack.sum(axis=(1, 2), dtype=np.float32))
        rows = np.flatnonzero(asked.any(axis=1))  # empty rows match nothing at any yaw
        sector = np.arange(sectors)
        turned = asked[rows][:, (sector - sector[:, None]) % sectors]  # (rows, turns, sectors)
        turned = turned.transpose(1, 0, 2).reshape(sectors, -1)
        common = stack[:, rows].reshape(len(stack), -1).astype(np.float32)
        shared = common @ turned.T.astype(np.float32)  # cell j of the query meets j + s of the template
        shift = shared.argmax(axis=1)
        score = shared[np.arange(len(stack)), shift] / np.maximum(norm, np.float32(1))
        return shift * (2 * np.pi / sectors), score
