"""Figures 7 and 8: how a search's time grows with the samples and with their dimensions.

The paper does not say what its vectors of more dimensions are. Ours are the share of non-empty cells
in every ring and each of g parts of the turn: 20 g numbers, CNZ for g = 1.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from numpy.typing import NDArray

from firstfix.engine.config import LshConfig, SearchConfig

from ...common.other_key_searches import build_search
from .matching import Timed
from .scene import PAPER, Taken

COUNTS = (1_000, 3_000, 10_000, 30_000, 99_000)
PARTS = (1, 3, 6, 12, 30)
QUERIES = 200  # held out: none of the samples
NEAREST = 10
ENGINES = ("kdtree", "lsh_kdtree", "exhaustive", "faiss_flat")
KEYS_A_BUCKET = 200


def measure_search_time(templates: Taken, folder: Path) -> list[dict[str, Any]]:
    """One thread's milliseconds a query and recall of the nearest ten; draws figure7.png and figure8.png."""
    shuffled = np.random.default_rng(7).permutation(len(templates))
    held_out, known = shuffled[:QUERIES], shuffled[QUERIES:]
    rows = []
    for parts in PARTS:
        vectors = pooled(templates.by[PAPER]["context"], parts)
        for count in [count for count in COUNTS if count <= len(known)]:
            keys = np.ascontiguousarray(vectors[known[:count]])
            truth: list[set[int]] = []
            for engine in ("exhaustive", *(e for e in ENGINES if e != "exhaustive")):
                search = build_search(engine, keys, config_for(count))
                timed = Timed()
                found = [
                    set(timed(partial(search.search, key, NEAREST)).tolist()) for key in vectors[held_out]
                ]
                truth = truth or found
                recall = np.mean([len(a & b) / len(b) for a, b in zip(found, truth, strict=True)])
                rows.append(
                    {
                        "engine": engine,
                        "samples": count,
                        "dimensions": keys.shape[1],
                        "ms": timed.ms,
                        "recall_at_10": round(float(recall), 3),
                    }
                )
    _draw(rows, "kdtree", "KD tree", folder / "figure7.png")
    _draw(rows, "lsh_kdtree", "LSH and KD trees", folder / "figure8.png")
    return rows


def config_for(count: int) -> SearchConfig:
    """With more samples longer hashes, so that a bucket stays as small as it was."""
    bits = max(2, round(float(np.log2(count / KEYS_A_BUCKET))))
    return SearchConfig(lsh=LshConfig(bits=bits))


def pooled(context: NDArray[np.floating], parts: int) -> NDArray[np.float32]:
    """(n, rings, sectors) to (n, rings * parts)."""
    count, rings, sectors = context.shape
    filled = (context > 0).reshape(count, rings, parts, sectors // parts)
    return filled.mean(axis=3, dtype=np.float32).reshape(count, -1)


def _draw(rows: list[dict[str, Any]], engine: str, title: str, path: Path) -> None:
    fig, (left, right) = plt.subplots(1, 2, figsize=(12, 4.5), sharey=True)
    mine = [row for row in rows if row["engine"] == engine]
    for axis, along, apart in (
        (left, "dimensions", "samples"),
        (right, "samples", "dimensions"),
    ):
        for value in sorted({row[apart] for row in mine}):
            line = [(row[along], row["ms"]) for row in mine if row[apart] == value]
            axis.plot(*zip(*line, strict=True), marker="o", label=f"{value} {apart}")
        axis.set(xlabel=along, xscale="log", yscale="log")
        axis.grid(alpha=0.3)
        axis.legend(fontsize=8)
    left.set_ylabel("ms a query")
    fig.suptitle(f"{title}: ten nearest, one thread")
    fig.tight_layout()
    fig.savefig(path, dpi=110)
    plt.close(fig)
