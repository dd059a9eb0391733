"""Views of a map from above, and the preview image of a version."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from firstfix.bit_exact.sample import rows_by_chance

PIXELS = 900  # along the longer side
_OPACITY = 0.45  # of one point: walls, with many points in a pixel, stand out


@dataclass(frozen=True)
class TopView:
    """Image of a map; the first row is the southern one, the first column the western one.

    Attributes:
        opacity: (rows, columns) 0 without a point, nearly 1 with many.
        height_m: (rows, columns) mean of the points in each pixel, 0 without a point.
        extent_m: west, east, south and north end.
    """

    opacity: NDArray[np.float64]
    height_m: NDArray[np.float64]
    extent_m: tuple[float, float, float, float]

    @classmethod
    def of(cls, points: NDArray[np.floating]) -> TopView:
        """View of (n, 3) points, one or more."""
        low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
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
        )


MAX_TEMPLATES = 50_000


def draw_preview(points: NDArray[np.floating], templates: NDArray[np.floating], path: Path) -> None:
    """PNG of (n, 3) map points and (m, 3) templates, in the index's levelled frame.

    No date and no tool's name go into the file: equal input gives equal bytes.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    view = TopView.of(points)
    low, high = np.percentile(view.height_m[view.opacity > 0], [2, 98])
    figure = Figure(figsize=(9, 9), dpi=120, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    axes.imshow(
        view.height_m,
        origin="lower",
        extent=view.extent_m,
        cmap="viridis",
        vmin=low,
        vmax=high,
        alpha=view.opacity,
    )
    some = templates[rows_by_chance(len(templates), MAX_TEMPLATES)]
    axes.scatter(some[:, 0], some[:, 1], s=1.5, c="tab:red", lw=0, alpha=0.6)
    axes.set_xlabel("x (m)")
    axes.set_ylabel("y (m)")
    axes.set_title(f"{len(templates):,} templates")
    figure.savefig(path, metadata={"Software": None})
