"""Rough figures of a map: its extent without stray points, and the spacing of its points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from firstfix.bit_exact.sample import rows_by_chance

from ..read_map.map_data import MapData

STRAY_PERCENT = 0.5  # of the points on each side, which do not count for the extent
# Points further from the middle than this and so many times the middle half's extent are no part of the map,
# as rows of zeros in a file of UTM coordinates.
FAR_M, FAR_TIMES = 2_000.0, 20.0
WHOLE_MORE = 1.05  # times the main extent: then the whole one is said, too
_SAMPLED_POINTS = 100_000


@dataclass(frozen=True)
class Shape:
    """Rough figures of a map.

    Attributes:
        extent_m: (3,) along x, y and z, in metres if the file's unit is the metre.
        whole_m: (3,) the same of all points, stray ones as well.
        spacing_m: median distance of a point from its nearest; None for a mesh.
    """

    extent_m: NDArray[np.float64]
    whole_m: NDArray[np.float64]
    spacing_m: float | None

    @classmethod
    def of(cls, data: MapData) -> Shape:
        """Measure a sample. Points on surfaces are sqrt(n / k) times as far apart in a sample of k of n."""
        sample = data.coordinates[rows_by_chance(len(data.coordinates), _SAMPLED_POINTS)]
        whole_m = np.array([float(np.ptp(values)) for values in data.coordinates.T])
        if data.points is None:
            return cls(np.ptp(sample, axis=0), whole_m, None)
        low, high = np.percentile(_near(sample), [STRAY_PERCENT, 100 - STRAY_PERCENT], axis=0)
        nearest_m = float(np.median(cKDTree(sample).query(sample, 2)[0][:, 1])) if len(sample) > 1 else 0.0
        return cls(high - low, whole_m, nearest_m * float(np.sqrt(len(sample) / len(data.points))))

    @property
    def numbers(self) -> dict[str, float]:
        """Figures for a finding."""
        x, y, height = (float(v) for v in self.extent_m)
        return {"x_m": x, "y_m": y, "height_m": height, "spacing_m": self.spacing_m or 0.0}

    @property
    def words(self) -> dict[str, str]:
        """The same as text."""
        spacing = "" if self.spacing_m is None else f" at a spacing of {_length(self.spacing_m)} m"
        return {"extent": _lengths(self.extent_m), "spacing": spacing}

    @property
    def whole(self) -> str:
        """The whole extent in words; empty where it is about the main one."""
        is_more = (self.whole_m > WHOLE_MORE * self.extent_m).any()
        return _lengths(self.whole_m) if is_more else ""


def _near(sample: NDArray[np.float64]) -> NDArray[np.float64]:
    """The (n, 3) points that are not far from all others."""
    first, middle, last = np.percentile(sample, [25, 50, 75], axis=0)
    near = np.abs(sample - middle).max(axis=1) <= FAR_M + FAR_TIMES * float((last - first).max())
    return sample[near]


def _lengths(extent_m: NDArray[np.float64]) -> str:
    return f"{' x '.join(_length(float(one)) for one in extent_m)} m"


def _length(metres: float) -> str:
    return f"{metres:,.0f}" if metres >= 10 else f"{metres:.2g}"
