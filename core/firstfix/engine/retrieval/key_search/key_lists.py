"""Inverted lists with their keys decoded, to search for many keys at once: FAISS takes them one by one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import faiss
import numpy as np
from numpy.typing import NDArray

from .... import native
from .faiss_indexes import probes_for


@dataclass(frozen=True)
class KeyLists:
    """Keys of all shards, n of them, list after list. Thread-safe.

    Attributes:
        first: an index with the centres of the lists.
        keys: (n, d) float32, as their codes give them.
        row: (n,) int64 of each key.
        start: (lists + 1,) int64, list i holds ``keys[start[i]:start[i + 1]]``.
    """

    first: faiss.IndexIVF
    keys: NDArray[np.float32]
    row: NDArray[np.int64]
    start: NDArray[np.int64]

    @classmethod
    def of(cls, indexes: Sequence[faiss.IndexIVF], rows: Sequence[NDArray[np.integer]]) -> KeyLists:
        """Lists of shards that have the same centres, and the (k,) rows of each shard's keys."""
        every = range(indexes[0].nlist)
        sizes = np.array([[index.invlists.list_size(number) for number in every] for index in indexes])
        start = np.concatenate([[0], np.cumsum(sizes.sum(axis=0))])
        keys, row = np.empty((start[-1], indexes[0].d), np.float32), np.empty(start[-1], np.int64)
        end = start[:-1] + np.cumsum(sizes, axis=0)  # (shards, lists)
        for index, own, ends, size in zip(indexes, rows, end, sizes, strict=True):
            decoded = index.reconstruct_n(0, index.ntotal)
            for number in np.flatnonzero(size).tolist():
                places = faiss.rev_swig_ptr(index.invlists.get_ids(number), int(size[number]))
                part = slice(ends[number] - size[number], ends[number])
                keys[part], row[part] = decoded[places], own[places]
        return cls(indexes[0], keys, row, start)

    def search(self, keys: NDArray[np.float32], count: int) -> NDArray[np.int64]:
        """Rows near (n, d) keys, nearest first: (n, at most ``count``), -1 where the lists hold fewer."""
        faiss.omp_set_num_threads(1)  # as in FaissSearch
        count = min(count, len(self.keys))
        _, probed = self.first.quantizer.search(keys, probes_for(self.first, count))
        found = native.nearest_in_lists(keys, probed, self.keys, self.start, count)
        return np.where(found < 0, -1, self.row[found])
