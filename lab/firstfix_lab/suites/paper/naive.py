"""The method as one would first write it in Python: what the ratios of the figures refer to."""

from __future__ import annotations

import math
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firstfix.descriptor import ScanBatch, rows_of
from firstfix_builder.templates.cluster import neighbour_pairs
from firstfix_builder.templates.linkage import Pairs, agglomerate

from .scene import DESCRIPTORS, GRID, PAPER, Taken

NEIGHBOURS = 100
THRESHOLD = 0.2


def naive_similarity(x: NDArray[np.floating], y: NDArray[np.floating]) -> float:
    """Equation 4, column by column."""
    total, counted = 0.0, 0
    for column in range(x.shape[1]):
        a, b = x[:, column], y[:, column]
        norm = math.sqrt(a @ a) * math.sqrt(b @ b)
        if norm > 0:
            total += float(a @ b) / norm
        counted += bool(a.any() or b.any())
    return total / max(1, counted)


def naive_clusters(samples: int, distances: dict[tuple[int, int], float], threshold: float) -> list[set[int]]:
    """Equation 1: of all pairs of clusters the nearest is merged, again and again."""
    clusters = {number: {number} for number in range(samples)}
    between = {pair: d for pair, d in distances.items() if d <= threshold}
    while between:
        a, b = min(between, key=lambda pair: (between[pair], pair))
        clusters[a] |= clusters.pop(b)
        merged = {}
        for (p, q), d in between.items():
            if {p, q} & {a, b}:
                continue
            merged[p, q] = d
        for c in clusters:
            if c != a:
                ends = (min(a, c), max(a, c)), (min(b, c), max(b, c))
                if all(end in between for end in ends):  # else some pair is not connected: distance 1
                    merged[ends[0]] = max(between[end] for end in ends)
        between = merged
    return list(clusters.values())


def naive_descriptor(points: NDArray[np.floating], height_m: float) -> NDArray[np.float64]:
    """PCA-SC, point by point."""
    xy = points[:, :2].astype(np.float64)
    values, vectors = np.linalg.eigh(np.cov(xy.T))
    axis = vectors[:, values.argmax()]
    if axis @ xy.mean(axis=0) < 0:
        axis = -axis
    angle = math.atan2(axis[1], axis[0])
    context = np.zeros((GRID.rings, GRID.sectors))
    for x, y, z in points.tolist():
        radius = math.hypot(x, y)
        if radius < GRID.max_range_m and z + height_m > 0.3:
            turn = (math.atan2(y, x) - angle) % (2 * math.pi)
            ring = int(radius / GRID.max_range_m * GRID.rings)
            sector = min(int(turn / (2 * math.pi) * GRID.sectors), GRID.sectors - 1)
            context[ring, sector] = max(context[ring, sector], z + height_m)
    return context


def compare_clustering(templates: Taken, samples: int) -> dict[str, Any]:
    """Ours and the naive one on the first templates; both give the same clusters, or this fails."""
    some = templates.subset(np.arange(samples))
    how, described = DESCRIPTORS[PAPER], some.by[PAPER]

    def ours() -> NDArray[np.intp]:
        parts = neighbour_pairs(how, described, some.position_m, NEIGHBOURS)
        pairs = Pairs.concatenate([part for _, part in parts])
        return agglomerate(samples, pairs, "complete", THRESHOLD)

    parts = neighbour_pairs(how, described, some.position_m, NEIGHBOURS)
    connected = Pairs.concatenate([part for _, part in parts])
    context = described["context"].astype(np.float64)

    def naive() -> list[set[int]]:
        distances = {
            (int(a), int(b)): 1 - naive_similarity(context[a], context[b])
            for a, b in zip(connected.a, connected.b, strict=True)
        }
        return naive_clusters(samples, distances, THRESHOLD)

    label, ours_s = _timed(ours)
    clusters, naive_s = _timed(naive)
    agreed = {frozenset(np.flatnonzero(label == c).tolist()) for c in range(label.max() + 1)}
    same = len(agreed & {frozenset(c) for c in clusters}) / len(agreed)
    return {
        "templates": samples,
        "ours_s": round(ours_s, 3),
        "naive_s": round(naive_s, 2),
        "ratio": round(naive_s / ours_s),
        "same_clusters": round(same, 4),
    }


def compare_descriptor(points: int) -> dict[str, Any]:
    """One scan of so many points: ours (with CNZ) and point by point."""
    rng = np.random.default_rng(5)
    scan = rng.normal(0, [20, 15, 1.5], (points, 3)).astype(np.float32)
    how = DESCRIPTORS[PAPER]
    batch = ScanBatch.single(scan, 1.0)
    each = [_timed(lambda: how.keys(how.describe(batch)))[1] for _ in range(50)]
    _, naive_s = _timed(lambda: naive_descriptor(scan, 1.0))
    ours_ms = 1e3 * float(np.median(each))
    return {
        "points": points,
        "ours_ms": round(ours_ms, 2),
        "naive_ms": round(1e3 * naive_s, 1),
        "ratio": round(1e3 * naive_s / ours_ms),
    }


def compare_match(templates: Taken, pairs: int) -> dict[str, Any]:
    """Milliseconds to compare two contexts, column by column: the paper's 1.02 ms."""
    described = templates.by[PAPER]
    context = rows_of(described, slice(0, pairs + 1))["context"].astype(np.float64)
    _, naive_s = _timed(lambda: [naive_similarity(context[0], other) for other in context[1:]])
    return {"pairs": pairs, "naive_ms_per_pair": round(1e3 * naive_s / pairs, 4)}


def _timed(work: Any) -> tuple[Any, float]:
    begin = time.process_time()
    result = work()
    return result, time.process_time() - begin
