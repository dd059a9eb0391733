"""The density of points that a moving scanner leaves on a surface, by its range."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from firstfix.bit_exact.sample import rows_by_chance

from .places.steps import SPACING_STEPS, VIEW_STEPS, stepped

RANGE_SAMPLES = 50_000
LEAST_RANGE_M = 0.5
DENSEST = 0.1  # of the points


@dataclass(frozen=True)
class Sampling:
    """Spacing of a cloud's points against their range from the nearest place of the scanner.

    Rays spread: the points of a surface become fewer with the square of its range. At short range the voxel
    grid of the map holds them all, and they become no denser.

    Attributes:
        spacing_m: of the points at the usual range: the medians over the cloud.
        range_m: the usual range.
        dense_spacing_m: of the densest tenth of the points, or less.
    """

    spacing_m: float
    range_m: float
    dense_spacing_m: float

    @classmethod
    def of(
        cls, points: NDArray[np.float64], spacings_m: NDArray[np.float64], places: NDArray[np.float64]
    ) -> Sampling:
        """Measures in coarse steps: a change in a part of the map leaves them as they are, as a rule.

        Args:
            points: (n, 3) metres, of which a sample is measured.
            spacings_m: (k,) at some of the points.
            places: (m, 3) where the scanner was.
        """
        some = points[rows_by_chance(len(points), RANGE_SAMPLES)]
        range_m = float(np.median(cKDTree(places).query(some)[0]))
        dense_m, median_m = np.quantile(spacings_m, [DENSEST, 0.5])
        return cls(
            stepped(float(median_m), SPACING_STEPS),
            stepped(max(range_m, LEAST_RANGE_M), VIEW_STEPS),
            stepped(float(dense_m), VIEW_STEPS),
        )

    def points_on(self, area_m2: float, range_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """The (n,) points that a surface of this area has at (n,) ranges."""
        near = self.spacing_m * np.maximum(range_m, 1e-9) / self.range_m
        points: NDArray[np.float64] = area_m2 / np.maximum(near, self.dense_spacing_m) ** 2
        return points
