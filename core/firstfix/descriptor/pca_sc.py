"""PCA-SC, the paper's descriptor: Scan Context in the frame of the scan's principal axes; its key is CNZ.

Paper III.A to III.C.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from .base import Described
from .polar import PolarGrid
from .principal_axes import principal_axes
from .scan_batch import ScanBatch
from .similarity import Columns, best_shift, similarity

MIN_HEIGHT_M = np.float32(0.01)  # of a filled cell with ground="keep"


@dataclass(frozen=True)
class PcaScanContext:
    """Maximum height over a polar grid that is turned to the scan's first principal axis.

    Attributes:
        grid: 20 rings x 60 sectors in the paper.
        height_origin: "floor", so that another mounting height changes nothing, or "sensor".
        ground: treatment of points on the floor. "raw": heights as measured; a cell whose maximum is not
            above the origin is empty. "keep": a cell with any return is filled. "drop": points less than
            ``ground_m`` above the floor are left out.
        ground_m: height above the floor.
        max_ratio: if the query's second eigenvalue is less than this share of its first, its axis is trusted
            and contexts are compared directly, else at every shift (equation 6).
        trusted_shifts: columns to either side that are tried if the axis is trusted.
    """

    arrays: ClassVar[tuple[str, ...]] = ("angle_rad", "ratio", "context")

    grid: PolarGrid
    height_origin: Literal["floor", "sensor"] = "floor"
    ground: Literal["raw", "keep", "drop"] = "drop"
    ground_m: float = 0.3
    max_ratio: float = 0.9
    trusted_shifts: int = 1

    def describe(self, scans: ScanBatch) -> Described:
        """Describe n levelled scans.

        Returns:
            angle_rad: (n,) float32, angle of the first principal axis in the scan's frame.
            ratio: (n,) float32 in 0..1, second eigenvalue over first.
            context: (n, rings, sectors) float16 metres, 0 in empty cells. Contexts are most of a template's
                bytes, and float16 (1 cm at 20 m) is finer than any map.
        """
        angle, ratio = principal_axes(scans, self.grid.max_range_m)
        context = np.zeros(len(scans) * self.grid.cells, np.float32)
        of_point = scans.scan_of_point
        x, y, z = scans.points.T
        above_floor = z + scans.height_m[of_point]
        if self.ground == "drop":
            kept = np.flatnonzero(above_floor > self.ground_m)
            x, y, z, above_floor, of_point = x[kept], y[kept], z[kept], above_floor[kept], of_point[kept]
        height = above_floor if self.height_origin == "floor" else z
        if self.ground == "keep":
            height = np.maximum(height, MIN_HEIGHT_M)
        c, s = np.cos(angle)[of_point], np.sin(angle)[of_point]
        inside, cell = self.grid.cells_of(c * x + s * y, c * y - s * x)
        np.maximum.at(context, of_point[inside] * self.grid.cells + cell, height[inside])
        return {
            "angle_rad": angle,
            "ratio": ratio,
            "context": context.reshape(-1, self.grid.rings, self.grid.sectors).astype(np.float16),
        }

    def keys(self, described: Described) -> NDArray[np.float32]:
        """CNZ keys, (n, rings): share of non-empty sectors of every ring, independent of the heading."""
        return (described["context"] > 0).mean(axis=-1, dtype=np.float32)

    def similarity(self, x: Described, y: Described) -> NDArray[np.float32]:
        """Similarities (n, m) by equation 4, without shifts."""
        return similarity(Columns.of(x["context"]), Columns.of(y["context"]))

    def match(
        self, query: Described, templates: Described, rows: NDArray[np.integer]
    ) -> tuple[NDArray[np.floating], NDArray[np.float32]]:
        """Compare the query with the (m,) given templates by equation 6.

        Returns:
            (m,) yaw of the query in each template's frame, radians, and (m,) similarity.
        """
        sectors = self.grid.sectors
        if query["ratio"][0] < self.max_ratio:
            shifts = np.arange(2 * self.trusted_shifts + 1) - self.trusted_shifts
            shifts = shifts[np.argsort(np.abs(shifts), kind="stable")]
        else:
            shifts = np.arange(sectors)
        contexts = templates["context"][rows]
        shift, score = best_shift(Columns.of(query["context"]), Columns.of(contexts), shifts)
        yaw = templates["angle_rad"][rows] - query["angle_rad"][0] + shift * (2 * np.pi / sectors)
        return yaw, score
