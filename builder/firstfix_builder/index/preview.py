"""A picture of a version: the map from above, coloured by height, and its templates."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from firstfix.bit_exact.sample import rows_by_chance

from .top_view import TopView

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
