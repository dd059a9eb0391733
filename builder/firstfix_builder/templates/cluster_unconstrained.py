"""Clustering that compares all pairs of templates, without the neighbour constraint (paper, Table II)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.cluster.hierarchy import fcluster, linkage
from scipy.spatial.distance import squareform

from firstfix.descriptor import Described, Descriptor, rows_of
from firstfix.engine.config import ClusterConfig
from firstfix.errors import BuildCancelled, BuildFailed

from .linkage import Pairs, agglomerate

DENSE_LIMIT = 10_000  # templates: their distances, and SciPy's linkage of them, take 1.6 GB
ROWS = 2048
STEP = 0.1  # of the threshold: fewer pairs of larger clusters are left for the next


def cluster_unconstrained(
    descriptor: Descriptor,
    described: Described,
    config: ClusterConfig,
    progress: Callable[[float], None],
    cancelled: Callable[[], bool],
) -> NDArray[np.intp]:
    """(n,) the cluster of each template. Time grows with the square of their number.

    Raises:
        BuildFailed: over DENSE_LIMIT templates, and the linkage is not complete.
        BuildCancelled: cancelled() said so.
    """
    count = len(next(iter(described.values())))
    if count <= DENSE_LIMIT:
        distance = np.clip(1 - descriptor.similarity(described, described), 0, None).astype(np.float64)
        condensed = squareform(distance, checks=False)
        if cancelled():
            raise BuildCancelled("cancelled while comparing templates")
        progress(0.5)
        if not len(condensed):
            return np.zeros(count, np.intp)
        tree = linkage(condensed, config.linkage)
        label: NDArray[np.intp] = fcluster(tree, config.threshold, "distance") - 1
        return label
    if config.linkage != "complete":
        raise BuildFailed(
            f"{config.linkage} linkage without neighbours takes up to {DENSE_LIMIT} templates, not {count}"
        )
    return _complete_by_blocks(descriptor, described, config.threshold, progress, cancelled)


def _complete_by_blocks(
    descriptor: Descriptor,
    described: Described,
    threshold: float,
    progress: Callable[[float], None],
    cancelled: Callable[[], bool],
) -> NDArray[np.intp]:
    """Complete linkage in bounded memory: it merges up to one step of the threshold after the other.

    All merges below one step come before those of the next step, so the steps together give the same tree.
    """
    label = np.arange(len(next(iter(described.values()))))
    steps = [*np.arange(STEP, threshold, STEP).tolist(), threshold]
    for number, step in enumerate(steps):
        progress(number / len(steps))
        pairs = cluster_pairs(descriptor, described, label, step, cancelled)
        label = agglomerate(int(label.max()) + 1, pairs, "complete", step)[label]
    return label


def cluster_pairs(
    descriptor: Descriptor,
    described: Described,
    label: NDArray[np.intp],
    threshold: float,
    cancelled: Callable[[], bool],
) -> Pairs:
    """Pairs of clusters whose templates are all within the threshold of each other (equation 1).

    Args:
        label: (n,) the cluster of each template, 0 and up, none empty.
    """
    order = np.argsort(label, kind="stable")
    start = np.searchsorted(label[order], np.arange(int(label.max()) + 2))
    cuts = np.flatnonzero(np.diff(start // ROWS, prepend=-1)).tolist()
    blocks = list(zip(cuts, [*cuts[1:], len(start) - 1], strict=True))
    blocks = [(low, high) for low, high in blocks if low < high]
    parts = []
    for number, (low, high) in enumerate(blocks):
        rows = rows_of(described, order[start[low] : start[high]])
        for other_low, other_high in blocks[number:]:
            if cancelled():
                raise BuildCancelled("cancelled while comparing templates")
            columns = rows_of(described, order[start[other_low] : start[other_high]])
            least = descriptor.similarity(rows, columns)
            least = np.minimum.reduceat(least, start[low:high] - start[low], axis=0)
            least = np.minimum.reduceat(least, start[other_low:other_high] - start[other_low], axis=1)
            a, b = np.nonzero(1 - least <= threshold)
            distance = 1 - least[a, b]
            keep = a + low < b + other_low
            parts.append(Pairs.of(a[keep] + low, b[keep] + other_low, distance[keep]))
    return Pairs.concatenate(parts)
