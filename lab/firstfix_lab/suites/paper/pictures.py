"""Figures 4 to 6: linkages, clusters by colour and size, representatives."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib
import numpy as np

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from numpy.typing import NDArray

from firstfix.engine.retrieval.cascade import Clusters

from .clusterings import Clusterer
from .scene import Taken

SAMPLES = 10_000
THRESHOLD = 0.4
DPI = 110


def draw_clusters(templates: Taken, folder: Path) -> dict[str, Any]:
    """Write figure4.png to figure6.png; the counts that they show."""
    some = templates.subset(np.arange(min(SAMPLES, len(templates))))
    clusterer = Clusterer(some)
    figures: dict[str, Any] = {"samples": len(some), "threshold": THRESHOLD}
    linkages = ("average", "complete", "single")
    by_linkage = {name: clusterer.with_neighbours(THRESHOLD, name).clusters for name in linkages}

    fig, axes = plt.subplots(1, 3, figsize=(15, 5.2))
    for axis, (name, clusters) in zip(axes, by_linkage.items(), strict=True):
        sizes = np.diff(clusters.start)
        _scatter(axis, some.position_m, _labels(clusters))
        axis.set_title(f"{name}: {len(clusters)} clusters, largest {sizes.max()}")
        figures[name] = {"clusters": len(clusters), "largest": int(sizes.max())}
    _save(fig, folder / "figure4.png")

    clusters = by_linkage["complete"]
    fig, (left, right) = plt.subplots(1, 2, figsize=(12, 5.2))
    _scatter(left, some.position_m, _labels(clusters))
    left.set_title("clusters, complete linkage among neighbours")
    right.bar(np.arange(len(clusters)), np.sort(np.diff(clusters.start))[::-1], width=1.0)
    right.set(xlabel="cluster, by size", ylabel="templates", title="templates in each")
    _save(fig, folder / "figure5.png")

    fig, axis = plt.subplots(figsize=(6.5, 6))
    _scatter(axis, some.position_m, _labels(clusters))
    chosen = some.position_m[clusters.representative]
    axis.scatter(chosen[:, 0], chosen[:, 1], s=5, c="black")
    axis.set_title("representatives")
    _save(fig, folder / "figure6.png")
    return figures


def _labels(clusters: Clusters) -> NDArray[np.intp]:
    label = np.empty(len(clusters.member), np.intp)
    label[clusters.member] = np.repeat(np.arange(len(clusters)), np.diff(clusters.start))
    return label


def _scatter(axis: Axes, position_m: NDArray[np.floating], label: NDArray[np.intp]) -> None:
    colour = np.random.default_rng(0).uniform(0.15, 0.95, (int(label.max()) + 1, 3))
    axis.scatter(position_m[:, 0], position_m[:, 1], s=3, c=colour[label], linewidths=0)
    axis.set_aspect("equal")
    axis.set(xlabel="x, m", ylabel="y, m")


def _save(figure: Any, path: Path) -> None:
    figure.tight_layout()
    figure.savefig(path, dpi=DPI)
    plt.close(figure)
