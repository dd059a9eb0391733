"""Clusters of similar templates, each with its representative (paper III.B)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from firstfix.descriptor import Described, Descriptor, rows_of
from firstfix.engine.config import ClusterConfig, DescriptorConfig
from firstfix.engine.retrieval.cascade import Clusters, Templates
from firstfix.errors import BuildCancelled

from ..execution.chunks import Arrays, Chunk
from .cluster_unconstrained import cluster_unconstrained
from .linkage import Pairs, agglomerate

BLOCK = 256  # templates that are compared with their neighbours at once, in the order of a KD tree's leaves
ROWS = 2048
CHUNK = 4096  # templates of one chunk


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
        return _clusters(descriptor, described, label)
    pairs = []
    for done, part in neighbour_pairs(descriptor, described, position_m, config.neighbours):
        if cancelled():
            raise BuildCancelled("cancelled while comparing templates")
        pairs.append(part)
        progress(done)
    return cluster_by_pairs(descriptor, described, len(position_m), pairs, config)


def cluster_by_pairs(
    descriptor: Descriptor,
    described: Described,
    count: int,
    pairs: Sequence[Pairs],
    config: ClusterConfig,
) -> Clusters:
    """Clusters of ``count`` templates from the pairs that were compared."""
    label = agglomerate(count, Pairs.concatenate(pairs), config.linkage, config.threshold)
    return _clusters(descriptor, described, label)


def neighbour_pairs(
    descriptor: Descriptor,
    described: Described,
    position_m: NDArray[np.floating],
    neighbours: int,
    rows: range | None = None,
) -> Iterator[tuple[float, Pairs]]:
    """Distances (equations 4 and 5) of every template to its nearest neighbours by position.

    Args:
        rows: only pairs of these templates with any other; None: all. A pair of mutual neighbours belongs to
            the first of the two.

    Yields:
        completed share of the templates, and a part of the pairs.
    """
    tree = cKDTree(position_m)
    near = _near(tree, position_m, neighbours, rows)
    order = tree.indices  # leaf by leaf: so the templates of a block have many neighbours in common
    if rows is not None:
        order = order[(order >= rows.start) & (order < rows.stop)]
    count = len(order)
    for start in range(0, count, BLOCK):
        block = order[start : start + BLOCK]
        here = near[block]
        columns, place = np.unique(here, return_inverse=True)
        alike = descriptor.similarity(rows_of(described, block), rows_of(described, columns))
        a = np.repeat(block, here.shape[1])
        b = here.ravel()
        distance = 1 - np.take_along_axis(alike, place.reshape(here.shape), axis=1).ravel()
        # a pair of mutual neighbours is kept once, by the first of the two
        keep = (a < b) | ((a > b) & ~(near[b] == a[:, None]).any(axis=1))
        yield (start + len(block)) / count, Pairs.of(a[keep], b[keep], distance[keep])


def _near(
    tree: cKDTree, position_m: NDArray[np.floating], neighbours: int, rows: range | None
) -> NDArray[np.intp]:
    """(n, k) nearest templates of each template, usually including itself.

    Only the given rows and their neighbours are filled in. The rest are zeros that take no memory.
    """
    count = len(position_m)
    near = np.zeros((count, min(neighbours + 1, count)), np.intp)

    def find(chosen: NDArray[np.integer]) -> None:
        found = tree.query(position_m[chosen], k=near.shape[1], workers=-1)[1]
        near[chosen] = found.reshape(len(chosen), -1)

    inside = np.arange(count) if rows is None else np.arange(rows.start, rows.stop)
    find(inside)
    outside = np.setdiff1d(near[inside], inside)
    if len(outside):
        find(outside)
    return near


@dataclass(frozen=True)
class ClusterChunk(Chunk):
    """Pairs of some templates and their neighbours, in or out of the chunk. Reads the input ``templates``.

    Attributes:
        first, last: rows of the templates, which stand tile by tile.
    """

    first: int
    last: int
    neighbours: int
    descriptor: DescriptorConfig

    def run(self, inputs: Mapping[str, Path]) -> Arrays:
        """The pairs of the chunk's rows."""
        descriptor = self.descriptor.make()
        made = Templates.load(inputs["templates"], descriptor)
        rows = range(self.first, self.last)
        parts = neighbour_pairs(descriptor, made.described, made.position_m, self.neighbours, rows)
        pairs = Pairs.concatenate([part for _, part in parts])
        return {"a": pairs.a, "b": pairs.b, "distance": pairs.distance}


def cluster_chunks(count: int, neighbours: int, descriptor: DescriptorConfig) -> list[ClusterChunk]:
    """The chunks for ``count`` templates."""
    return [
        ClusterChunk(first, min(first + CHUNK, count), neighbours, descriptor)
        for first in range(0, count, CHUNK)
    ]


def _clusters(descriptor: Descriptor, described: Described, label: NDArray[np.intp]) -> Clusters:
    return Clusters.from_labels(label, lambda rows: most_typical(descriptor, rows_of(described, rows)))


def most_typical(descriptor: Descriptor, described: Described) -> int:
    """Row of the template that is most similar to all others (equation 7)."""
    count = len(next(iter(described.values())))
    total = np.concatenate(
        [
            descriptor.similarity(rows_of(described, slice(start, start + ROWS)), described).sum(axis=1)
            for start in range(0, count, ROWS)
        ]
    )
    return int(total.argmax())
