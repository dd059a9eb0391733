"""A picture of a version: the map from above, coloured by height, and its templates."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from firstfix.portable.sample import rows_by_chance

MAX_POINTS = 400_000


def draw_preview(points: NDArray[np.floating], templates: NDArray[np.floating], path: Path) -> None:
    """PNG of (n, 3) map points and (m, 3) templates, in the index's levelled frame.

    No date and no tool's name go into the file: equal input gives equal bytes.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    shown = points[rows_by_chance(len(points), MAX_POINTS)]
    shown = shown[np.argsort(shown[:, 2], kind="stable")]
    low, high = np.percentile(shown[:, 2], [2, 98])
    figure = Figure(figsize=(9, 9), dpi=120, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    axes.scatter(shown[:, 0], shown[:, 1], c=shown[:, 2], s=0.2, cmap="viridis", vmin=low, vmax=high, lw=0)
    some = templates[rows_by_chance(len(templates), MAX_POINTS)]
    axes.scatter(some[:, 0], some[:, 1], s=1.5, c="tab:red", lw=0, alpha=0.6)
    axes.set_aspect("equal")
    axes.set_xlabel("x (m)")
    axes.set_ylabel("y (m)")
    axes.set_title(f"{len(templates):,} templates")
    figure.savefig(path, metadata={"Software": None})
