"""The default engine's descriptor: which cells of the polar grid hold something, layer by layer.

Maximum height alone wastes an indoor scan: it sees the ceiling. Occupancy in several height layers
keeps what stands at every height, in bits. Its key is the magnitude of the first Fourier coefficients
of every ring (docs/method.md): turning the robot only shifts the phases, so the key stays the same.
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
        edges_m: layer boundaries above the floor, ascending: n + 1 edges make n layers; what is
            below the first (the floor itself) or above the last counts nowhere.
        coefficients: of every ring's spectrum that the key keeps.
    """

    arrays: ClassVar[tuple[str, ...]] = ("occupancy",)

    grid: PolarGrid
    edges_m: tuple[float, ...] = (0.3, 1.0, 1.8, 3.0, 6.0, 25.0)
    coefficients: int = 8

    @property
    def rows(self) -> int:
        """Layers times rings: one circular signal over the sectors each."""
        return (len(self.edges_m) - 1) * self.grid.rings

    def describe(self, scans: ScanBatch) -> Described:
        """occupancy: (n, ceil(rows * sectors / 8)) uint8, packed bits (docs/method.md 3.1)."""
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
        """(n, rows, sectors), 0 or 1."""
        bits = np.unpackbits(described["occupancy"], axis=1, count=self.rows * self.grid.sectors)
        return bits.reshape(-1, self.rows, self.grid.sectors)

    def keys(self, described: Described) -> NDArray[np.float32]:
        """The ring spectrum: (n, rows * coefficients), of unit length.

        Coefficients past the mean count twice in the signal's energy (Parseval), hence the root of two.
        """
        signal = self.filled(described).astype(np.float32)
        spectrum = np.abs(np.fft.rfft(signal, axis=-1))[..., : self.coefficients].astype(np.float32)
        spectrum[..., 1:] *= np.float32(np.sqrt(2))
        key = spectrum.reshape(len(signal), -1)
        key /= np.maximum(np.linalg.norm(key, axis=1, keepdims=True), 1e-9)
        return key

    def similarity(self, x: Described, y: Described) -> NDArray[np.float32]:
        """Cosine of the occupied cells as they lie: (n, m)."""
        a, b = (self.filled(d).reshape(-1, self.rows * self.grid.sectors).astype(np.float32) for d in (x, y))
        alike: NDArray[np.float32] = a @ b.T
        alike /= np.maximum(np.sqrt(np.outer(a.sum(axis=1), b.sum(axis=1))), 1)
        return alike

    def match(
        self, query: Described, templates: Described
    ) -> tuple[NDArray[np.floating], NDArray[np.float32]]:
        """The turn at which each template explains the query best (docs/method.md 3.3)."""
        asked, stack = self.filled(query)[0], self.filled(templates)
        sectors = self.grid.sectors
        norm = np.sqrt(np.float32(asked.sum()) * stack.sum(axis=(1, 2), dtype=np.float32))
        rows = np.flatnonzero(asked.any(axis=1))  # the others meet nothing at any turn
        sector = np.arange(sectors)
        turned = asked[rows][:, (sector - sector[:, None]) % sectors]  # (rows, turns, sectors)
        turned = turned.transpose(1, 0, 2).reshape(sectors, -1)
        common = stack[:, rows].reshape(len(stack), -1).astype(np.float32)
        overlap = common @ turned.T.astype(np.float32)  # cell j of the query meets j + s of the template
        shift = overlap.argmax(axis=1)
        score = overlap[np.arange(len(stack)), shift] / np.maximum(norm, np.float32(1))
        return shift * (2 * np.pi / sectors), score
