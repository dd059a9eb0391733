"""The templates' clusters by threshold, with the constraint and without, and what they cost."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from firstfix.descriptor import rows_of
from firstfix.engine.retrieval.cascade import Clusters
from firstfix_builder.templates.cluster import most_typical, neighbour_pairs
from firstfix_builder.templates.cluster_unconstrained import cluster_pairs
from firstfix_builder.templates.linkage import Linkage, Pairs, agglomerate

from .scene import DESCRIPTORS, PAPER, Taken

NEIGHBOURS = 100  # by position, that a template is compared with


@dataclass(frozen=True)
class Clustering:
    """Clusters of one threshold, and the time they took.

    Attributes:
        constraint: "knn" or "none".
        similarity_s, linkage_s, choice_s: one thread's seconds to compare, link and choose representatives.
    """

    constraint: str
    threshold: float
    clusters: Clusters
    similarity_s: float
    linkage_s: float
    choice_s: float


class Clusterer:
    """Clusters one set of templates again and again; the neighbours are compared once."""

    def __init__(self, templates: Taken) -> None:
        self._how, self._described = DESCRIPTORS[PAPER], templates.by[PAPER]
        self._count = len(templates)
        begin = time.process_time()
        parts = neighbour_pairs(self._how, self._described, templates.position_m, NEIGHBOURS)
        self._pairs = Pairs.concatenate([part for _, part in parts])
        self._similarity_s = time.process_time() - begin

    def with_neighbours(self, threshold: float, linkage: Linkage = "complete") -> Clustering:
        begin = time.process_time()
        label = agglomerate(self._count, self._pairs, linkage, threshold)
        return self._chosen("knn", threshold, label, self._similarity_s, time.process_time() - begin)

    def without(self, thresholds: tuple[float, ...]) -> Iterator[Clustering]:
        """Clusters without the constraint: all templates are compared, in blocks.

        Each threshold starts from the clusters of the last one. Its seconds include all thresholds so far.
        """
        label = np.arange(self._count)
        similarity_s = linkage_s = 0.0
        for threshold in thresholds:
            begin = time.process_time()
            pairs = cluster_pairs(self._how, self._described, label, threshold, lambda: False)
            similarity_s += time.process_time() - begin
            begin = time.process_time()
            label = agglomerate(int(label.max()) + 1, pairs, "complete", threshold)[label]
            linkage_s += time.process_time() - begin
            yield self._chosen("none", threshold, label, similarity_s, linkage_s)

    def _chosen(
        self,
        constraint: str,
        threshold: float,
        label: NDArray[np.intp],
        similarity_s: float,
        linkage_s: float,
    ) -> Clustering:
        begin = time.process_time()
        clusters = Clusters.from_labels(
            label, lambda rows: most_typical(self._how, rows_of(self._described, rows))
        )
        choice_s = time.process_time() - begin
        return Clustering(constraint, threshold, clusters, similarity_s, linkage_s, choice_s)
