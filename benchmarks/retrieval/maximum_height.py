"""A descriptor to compare the default with: the highest point of every cell, as in Scan Context."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from firstfix.descriptor import Described, PolarGrid, ScanBatch

GROUND_M = 0.3  # what lies lower counts nowhere, as in the default


@dataclass(frozen=True)
class MaximumHeight:
    """One layer of heights in place of several of occupancy; key and comparison as the default's."""

    arrays: ClassVar[tuple[str, ...]] = ("height",)

    grid: PolarGrid
    coefficients: int = 8

    def describe(self, scans: ScanBatch) -> Described:
        """height: (n, rings, sectors) float16 metres above the floor, 0 where nothing stands."""
        above = scans.points[:, 2] + scans.height_m[scans.scan_of_point]
        rows = np.flatnonzero(above > GROUND_M)
        inside, cell = self.grid.cells_of(scans.points[rows, 0], scans.points[rows, 1])
        rows = rows[inside]
        height = np.zeros(len(scans) * self.grid.cells, np.float32)
        np.maximum.at(height, scans.scan_of_point[rows] * self.grid.cells + cell, above[rows])
        return {"height": height.reshape(-1, self.grid.rings, self.grid.sectors).astype(np.float16)}

    def keys(self, described: Described) -> NDArray[np.float32]:
        """(n, rings * coefficients), of unit length."""
        spectrum = np.abs(np.fft.rfft(described["height"].astype(np.float32), axis=-1))
        spectrum = spectrum[..., : self.coefficients].astype(np.float32)
        spectrum[..., 1:] *= np.float32(np.sqrt(2))
        key = spectrum.reshape(len(spectrum), -1)
        key /= np.maximum(np.linalg.norm(key, axis=1, keepdims=True), 1e-9)
        return key

    def similarity(self, x: Described, y: Described) -> NDArray[np.float32]:
        a, b = (_unit(d["height"].reshape(len(d["height"]), -1)) for d in (x, y))
        alike: NDArray[np.float32] = a @ b.T
        return alike

    def match(
        self, query: Described, templates: Described, rows: NDArray[np.integer]
    ) -> tuple[NDArray[np.floating], NDArray[np.float32]]:
        sectors = self.grid.sectors
        turned = np.stack([np.roll(query["height"][0], s, axis=1).ravel() for s in range(sectors)])
        alike = _unit(templates["height"][rows].reshape(len(rows), -1)) @ _unit(turned).T
        return alike.argmax(axis=1) * (2 * np.pi / sectors), alike.max(axis=1)


def _unit(rows: NDArray[np.floating]) -> NDArray[np.float32]:
    rows = rows.astype(np.float32)
    return rows / np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), np.float32(1e-9))
