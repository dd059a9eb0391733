"""Groups of templates that look alike, and the one that stands for each (paper III.B)."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from firstfix.clusters import Clusters
from firstfix.descriptor import Described, Descriptor, rows_of
from firstfix.engine_config import ClusterConfig
from firstfix.errors import BuildCancelled

from .cluster_unconstrained import cluster_unconstrained
from .linkage import Pairs, agglomerate

BLOCK = 256  # templates compared with their neighbours at once; in the order of a KD tree's leaves
ROWS = 2048


def cluster_templates(
    descriptor: Descriptor,
    described: Described,
    position_m: NDArray[np.floating],
    config: ClusterConfig,
    progress: Callable[[float], None] = lambda fraction: None,
    cancelled: Callable[[], bool] = lambda: False,
) -> Clusters:
    """Clusters of n templates at (n, 3) positions.

    Raises:
        BuildFailed: too many templates for this linkage without neighbours.
        BuildCancelled: cancelled() said so.
    """
    if config.neighbours is None:
        label = cluster_unconstrained(descriptor, described, config, progress, cancelled)
    else:
        pairs = []
        for done, part in neighbour_pairs(descriptor, described, position_m, config.neighbours):
            if cancelled():
                raise BuildCancelled("cancelled while comparing templates")
            pairs.append(part)
            progress(done)
        label = agglomerate(len(position_m), Pairs.concatenate(pairs), config.linkage, config.threshold)
    return Clusters.from_labels(label, lambda rows: most_typical(descriptor, rows_of(described, rows)))


def neighbour_pairs(
    descriptor: Descriptor, described: Described, position_m: NDArray[np.floating], neighbours: int
) -> Iterator[tuple[float, Pairs]]:
    """Distances (equations 4 and 5) of every template to its nearest neighbours by position.

    Yields:
        share of the templates done, and a part of the pairs.
    """
    count = len(position_m)
    tree = cKDTree(position_m)
    _, near = tree.query(position_m, k=min(neighbours + 1, count), workers=-1)
    near = near.reshape(count, -1)
    order = tree.indices  # leaf by leaf: a block of templates and their neighbours are few
    for start in range(0, count, BLOCK):
        block = order[start : start + BLOCK]
        here = near[block]
        columns, place = np.unique(here, return_inverse=True)
        alike = descriptor.similarity(rows_of(described, block), rows_of(described, columns))
        a = np.repeat(block, here.shape[1])
        b = here.ravel()
        distance = 1 - np.take_along_axis(alike, place.reshape(here.shape), axis=1).ravel()
        # of two that are each other's neighbours only the first keeps the pair
        keep = (a < b) | ((a > b) & ~(near[b] == a[:, None]).any(axis=1))
        yield (start + len(block)) / count, Pairs.of(a[keep], b[keep], distance[keep])


def most_typical(descriptor: Descriptor, described: Described) -> int:
    """Equation 7: the row of the template that is most like all the others."""
    count = len(next(iter(described.values())))
    total = np.concatenate(
        [
            descriptor.similarity(rows_of(described, slice(start, start + ROWS)), described).sum(axis=1)
            for start in range(0, count, ROWS)
        ]
    )
    return int(total.argmax())
