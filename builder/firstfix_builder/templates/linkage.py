"""Hierarchical clustering of a sparse graph, cut at a distance (paper III.B, equations 1 to 3).

Where two samples are not connected their similarity is zero and so their distance one, as the paper
says; no library does that at bounded memory. SciPy's linkage takes the dense matrix, 40 GB for 100k
samples; scikit-learn's with connectivity leaves the missing pairs out of the maximum, so that chains
of neighbours grow without bound.

All pairs of clusters that are each other's nearest are merged in one round: for these linkages that
gives the tree that merging the nearest pair, one at a time, would give (they are reducible: a merged
cluster is never nearer to a third than the nearer of its parts was).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

Linkage: TypeAlias = Literal["complete", "average", "single"]


@dataclass(frozen=True)
class Pairs:
    """Known distances between samples or clusters, each pair once, a < b.

    Attributes:
        a, b: (m,) their numbers.
        distance: (m,) 0..1.
    """

    a: NDArray[np.int32]
    b: NDArray[np.int32]
    distance: NDArray[np.float32]

    @classmethod
    def of(cls, a: NDArray[np.integer], b: NDArray[np.integer], distance: NDArray[np.floating]) -> Pairs:
        """In either order."""
        return cls(
            np.minimum(a, b).astype(np.int32), np.maximum(a, b).astype(np.int32), distance.astype(np.float32)
        )

    @classmethod
    def concatenate(cls, parts: Sequence[Pairs]) -> Pairs:
        """Join pairs, in their order."""
        return cls(
            np.concatenate([part.a for part in parts]),
            np.concatenate([part.b for part in parts]),
            np.concatenate([part.distance for part in parts]),
        )

    def __len__(self) -> int:
        return len(self.a)


_COMBINE = {"complete": np.maximum, "average": np.add, "single": np.minimum}


def agglomerate(samples: int, pairs: Pairs, linkage: Linkage, threshold: float) -> NDArray[np.intp]:
    """The clusters that merging up to a distance leaves.

    Args:
        samples: how many there are, the unconnected included.
        pairs: of samples; the distance of any other pair is 1.
        threshold: below 1; clusters further apart are not merged.

    Returns:
        (samples,) the cluster of each, 0 and up, in the order of their first samples.
    """
    threshold = float(np.float32(threshold))  # as precise as the distances are: equal is merged
    links = _Links(pairs.a, pairs.b, pairs.distance.astype(np.float64), np.ones(len(pairs), np.int64))
    if linkage != "average":  # pairs that are further apart are never merged
        links = links.taken(pairs.distance <= threshold)
    label, size = np.arange(samples, dtype=np.int32), np.ones(samples, np.int64)
    while True:
        into = _mutually_nearest(samples, links, links.distance(size, linkage), threshold)
        if into is None:
            break
        label = into[label]
        size = np.bincount(label, minlength=samples)
        links = links.joined(into, linkage)
        if linkage == "complete":
            links = links.taken(links.distance(size, linkage) <= threshold)
    _, compact = np.unique(label, return_inverse=True)
    return compact


@dataclass(frozen=True)
class _Links:
    """Pairs of clusters with connected samples, each once.

    Attributes:
        a, b: (m,) clusters.
        value: (m,) largest, smallest or sum of the distances of the connected samples.
        known: (m,) how many pairs of samples are connected.
    """

    a: NDArray[np.int32]
    b: NDArray[np.int32]
    value: NDArray[np.float64]
    known: NDArray[np.int64]

    def distance(self, size: NDArray[np.int64], linkage: Linkage) -> NDArray[np.float64]:
        """Equations 1 to 3, with 1 for every pair of samples that is not connected."""
        if linkage == "single":
            return self.value
        every = size[self.a] * size[self.b]
        if linkage == "complete":
            return np.where(self.known == every, self.value, 1.0)
        return (self.value + (every - self.known)) / every

    def taken(self, kept: NDArray[np.bool_] | NDArray[np.intp]) -> _Links:
        return _Links(self.a[kept], self.b[kept], self.value[kept], self.known[kept])

    def joined(self, into: NDArray[np.int32], linkage: Linkage) -> _Links:
        """The links once every cluster has gone into the given one."""
        a, b = into[self.a], into[self.b]
        moved = _Links(np.minimum(a, b), np.maximum(a, b), self.value, self.known).taken(a != b)
        if not len(moved.a):
            return moved
        moved = moved.taken(np.lexsort((moved.b, moved.a)))
        first = np.flatnonzero(np.r_[True, (np.diff(moved.a) != 0) | (np.diff(moved.b) != 0)])
        return _Links(
            moved.a[first],
            moved.b[first],
            _COMBINE[linkage].reduceat(moved.value, first),
            np.add.reduceat(moved.known, first),
        )


def _mutually_nearest(
    samples: int, links: _Links, distance: NDArray[np.float64], threshold: float
) -> NDArray[np.int32] | None:
    """(samples,) the cluster that each cluster goes into; None where nothing is near enough."""
    near = np.flatnonzero(distance <= threshold)
    if not len(near):
        return None
    # ties go by number, so that of the nearest pairs at least one is mutual
    order = near[np.lexsort((links.b[near], links.a[near], distance[near]))]
    a, b, rank = links.a[order], links.b[order], np.arange(len(order))
    nearest = np.full(samples, len(order))
    np.minimum.at(nearest, a, rank)
    np.minimum.at(nearest, b, rank)
    mutual = (nearest[a] == rank) & (nearest[b] == rank)
    into = np.arange(samples, dtype=np.int32)
    into[b[mutual]] = a[mutual]
    return into
