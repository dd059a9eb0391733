"""Views of a map from above, and the preview image of a version."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from firstfix.bit_exact.sample import rows_by_chance

from ..plot import RED, Plot

PIXELS = 900  # along the longer side
MAX_POINTS = 2_000_000
_OPACITY = 0.45  # of one point: walls, with many points in a pixel, stand out


@dataclass(frozen=True)
class TopView:
    """Image of a map; the first row is the southern one, the first column the western one.

    Attributes:
        opacity: (rows, columns) 0 without a point, nearly 1 with many.
        height_m: (rows, columns) mean of the points in each pixel, 0 without a point.
        extent_m: west, east, south and north end.
        pixel_m: edge of a pixel.
    """

    opacity: NDArray[np.float64]
    height_m: NDArray[np.float64]
    extent_m: tuple[float, float, float, float]
    pixel_m: float

    @classmethod
    def of(cls, points: NDArray[np.floating]) -> TopView:
        """View of (n, 3) points, one or more. Of many points some by chance: a pixel needs few."""
        low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
        if len(points) > MAX_POINTS:
            points = points[rows_by_chance(len(points), MAX_POINTS)]
        pixel_m = max(float((high - low).max()) / PIXELS, 1e-3)
        column, row = ((points[:, :2] - low) / pixel_m).astype(np.int64).T
        columns, rows = int(column.max()) + 1, int(row.max()) + 1
        pixel = row * columns + column
        count = np.bincount(pixel, minlength=rows * columns).astype(np.float64)
        height_m = np.bincount(pixel, points[:, 2], minlength=rows * columns) / np.maximum(count, 1)
        opacity: NDArray[np.float64] = 1 - np.power(1 - _OPACITY, count)
        west, south = (float(corner) for corner in low)
        return cls(
            opacity.reshape(rows, columns),
            height_m.reshape(rows, columns),
            (west, west + columns * pixel_m, south, south + rows * pixel_m),
            pixel_m,
        )


MAX_TEMPLATES = 20_000
_OUTLIERS = 2  # percent of the heights at either end, that get the colours of the ends
# Colours of heights, from low to high: the map "viridis" of matplotlib at even steps.
_COLOURS = (
    (68, 1, 84),
    (71, 45, 123),
    (59, 82, 139),
    (44, 114, 142),
    (33, 145, 140),
    (40, 174, 128),
    (94, 201, 98),
    (173, 220, 48),
    (253, 231, 37),
)


def draw_preview(points: NDArray[np.floating], templates: NDArray[np.floating], path: Path) -> None:
    """PNG of (n, 3) map points and (m, 3) templates, in the index's levelled frame."""
    view = TopView.of(points)
    plot = Plot(view.extent_m, view.pixel_m)
    plot.image(_coloured(view), view.opacity)
    some = templates[rows_by_chance(len(templates), MAX_TEMPLATES)]
    plot.marks(some, RED, 1.3, opacity=0.6)
    plot.save(path, x="x (m)", y="y (m)", title=f"{len(templates):,} templates")


def _coloured(view: TopView) -> NDArray[np.uint8]:
    """(rows, columns, 3) colours of a view's heights."""
    seen = view.height_m[view.opacity > 0]
    low, high = np.percentile(seen, [_OUTLIERS, 100 - _OUTLIERS])
    step = np.linspace(low, max(high, low + 1e-3), len(_COLOURS))
    bands = [np.interp(view.height_m, step, band).astype(np.uint8) for band in np.array(_COLOURS).T]
    return np.stack(bands, axis=-1)
