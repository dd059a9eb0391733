"""FAISS: linear but fast (flat, 8 bits a number), and sublinear (inverted lists, a graph)."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import faiss
import numpy as np
from numpy.typing import NDArray

from ..engine_config import SearchConfig

FILE = "keys.faiss"
_L2 = faiss.METRIC_L2
IVF_KEYS_A_LIST = 256
IVF_PROBES = 16
HNSW_LINKS = 32
HNSW_SEARCH = 128


class FaissSearch:
    """The index that the config's ``engine`` names."""

    def __init__(self, index: faiss.Index) -> None:
        self._index = index

    @classmethod
    def build(cls, keys: NDArray[np.float32], config: SearchConfig) -> FaissSearch:
        faiss.omp_set_num_threads(1)  # a graph's links depend on the order in which threads get to them
        index = _INDEXES[config.engine](*keys.shape)
        index.train(keys)
        index.add(keys)
        return cls(index)

    def search(self, key: NDArray[np.float32], count: int) -> NDArray[np.int64]:
        # queries run side by side in threads of their own; a team of threads for each would only wait:
        # 12 ms in place of 0.1 on busy cores. The setting is the calling thread's.
        faiss.omp_set_num_threads(1)
        _, rows = self._index.search(key[None], min(count, self._index.ntotal))
        found: NDArray[np.int64] = rows[0]
        return found[found >= 0]

    def save(self, directory: Path) -> None:
        faiss.write_index(self._index, str(directory / FILE))

    @classmethod
    def load(cls, directory: Path, config: SearchConfig) -> FaissSearch:
        return cls(faiss.read_index(str(directory / FILE), faiss.IO_FLAG_MMAP | faiss.IO_FLAG_READ_ONLY))


def _flat(count: int, dimensions: int) -> faiss.Index:
    return faiss.IndexFlat(dimensions, _L2)


def _sq8(count: int, dimensions: int) -> faiss.Index:
    return faiss.IndexScalarQuantizer(dimensions, faiss.ScalarQuantizer.QT_8bit, _L2)


def _ivf(count: int, dimensions: int) -> faiss.Index:
    lists = max(1, count // IVF_KEYS_A_LIST)
    index = faiss.IndexIVFFlat(faiss.IndexFlat(dimensions, _L2), dimensions, lists, _L2)
    index.nprobe = min(lists, IVF_PROBES)
    return index


def _hnsw(count: int, dimensions: int) -> faiss.Index:
    index = faiss.IndexHNSWFlat(dimensions, HNSW_LINKS, _L2)
    index.hnsw.efSearch = HNSW_SEARCH
    return index


_INDEXES: dict[str, Callable[[int, int], faiss.Index]] = {
    "faiss_flat": _flat,
    "faiss_sq8": _sq8,
    "faiss_ivf": _ivf,
    "faiss_hnsw": _hnsw,
}
