"""Clusters of templates, each with its representative (paper III.B)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..array_file import check_numbers


@dataclass(frozen=True)
class Clusters:
    """c clusters of n templates.

    Attributes:
        representative: (c,) int32, template that represents each cluster.
        start: (c + 1,) int32, cluster i holds ``member[start[i]:start[i + 1]]``.
        member: (n,) int32, templates, cluster after cluster, ascending in each.
    """

    representative: NDArray[np.int32]
    start: NDArray[np.int32]
    member: NDArray[np.int32]

    @classmethod
    def alone(cls, count: int) -> Clusters:
        """Clusters of one template each."""
        every = np.arange(count + 1, dtype=np.int32)
        return cls(every[:-1], every, every[:-1])

    @classmethod
    def from_labels(
        cls, label: NDArray[np.intp], most_typical: Callable[[NDArray[np.int32]], int]
    ) -> Clusters:
        """Clusters from labels.

        Args:
            label: (n,) cluster of each template, 0 to c - 1, none of them empty.
            most_typical: returns which of the (k,) templates of a cluster, two or more, represents it, 0 to k
                - 1.
        """
        member = np.argsort(label, kind="stable").astype(np.int32)
        start = np.concatenate([[0], np.cumsum(np.bincount(label))]).astype(np.int32)
        groups = np.split(member, start[1:-1])
        chosen = [group[most_typical(group) if len(group) > 1 else 0] for group in groups]
        return cls(np.array(chosen, np.int32), start, member)

    def __len__(self) -> int:
        return len(self.representative)

    def members(self, clusters: NDArray[np.integer]) -> NDArray[np.int32]:
        """Templates of the given clusters, in the order of the clusters."""
        begin, end = self.start[clusters], self.start[np.asarray(clusters) + 1]
        size = end - begin
        before = np.cumsum(size) - size  # members of all earlier clusters
        return self.member[np.repeat(begin - before, size) + np.arange(size.sum())]

    def save(self, directory: Path) -> None:
        """Writes a version's files."""
        for field in fields(self):
            np.save(directory / f"cluster_{field.name}.npy", getattr(self, field.name))

    @classmethod
    def load(cls, directory: Path) -> Clusters:
        """Reads a version's files, memory-mapped.

        Raises:
            ValueError, OSError: a file is missing or damaged, or does not fit the others.
        """
        clusters = cls(
            **{f.name: np.load(directory / f"cluster_{f.name}.npy", mmap_mode="r") for f in fields(cls)}
        )
        start, count = clusters.start, len(clusters)
        if start.shape != (count + 1,) or start[0] != 0 or start[-1] != len(clusters.member):
            raise ValueError("cluster_start.npy does not fit the clusters and their members")
        check_numbers("cluster_start.npy", start, len(clusters.member) + 1, ascending=True)
        check_numbers("cluster_member.npy", clusters.member, len(clusters.member))
        check_numbers("cluster_representative.npy", clusters.representative, len(clusters.member))
        return clusters
