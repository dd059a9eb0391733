"""Key searches that no map has, beside those of the engine: what FAISS offers besides, and how it does there.

Whole keys, in one list or in many that are probed; product codes; a graph.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import faiss
import numpy as np
from numpy.typing import NDArray

from firstfix.bit_exact.sample import rows_by_chance
from firstfix.engine.config import SearchConfig
from firstfix.engine.retrieval.key_search import ENGINES, KeySearch, build_key_search, load_key_search

FILE = "keys.faiss"
KEYS_A_LIST = 256
PROBES = {"faiss_ivf": 16, "faiss_ivf_pq": 128}
TRAINED_KEYS_A_LIST, MIN_TRAINED_KEYS, TRAINED_TURNS = 64, 10_000, 10
HNSW_LINKS, HNSW_SEARCH = 32, 128
PQ_NUMBERS = 4  # of a key, in one byte of its code


class OtherSearch:
    """Search in one FAISS index, on one thread."""

    def __init__(self, index: faiss.Index) -> None:
        self.index = index

    def __len__(self) -> int:
        return int(self.index.ntotal)

    def search(self, key: NDArray[np.float32], count: int) -> NDArray[np.int64]:
        """Rows of at most ``count`` keys near a (d,) key, nearest first."""
        faiss.omp_set_num_threads(1)
        found: NDArray[np.int64] = self.index.search(key[None], min(count, len(self)))[1][0]
        return found[found >= 0]

    def save(self, directory: Path) -> None:
        """Write the index into a folder."""
        faiss.write_index(self.index, str(directory / FILE))

    @classmethod
    def load(cls, directory: Path) -> OtherSearch:
        """Read what ``save`` wrote, memory-mapped."""
        return cls(faiss.read_index(str(directory / FILE), faiss.IO_FLAG_MMAP_IFC | faiss.IO_FLAG_READ_ONLY))


def build_search(
    engine: str,
    keys: NDArray[np.float32],
    config: SearchConfig,
    position_m: NDArray[np.floating] | None = None,
) -> KeySearch | OtherSearch:
    """Build a search of the engine's, or another one, over (n, d) keys at (n, 3) positions."""
    if engine in ENGINES:
        return build_key_search(keys, config.model_copy(update={"engine": engine}), position_m)
    faiss.omp_set_num_threads(1)  # with several threads a graph's links would depend on their timing
    index = OTHERS[engine](*keys.shape)
    if not index.is_trained:
        needed = max(TRAINED_KEYS_A_LIST * index.nlist, MIN_TRAINED_KEYS)
        index.train(np.ascontiguousarray(keys[rows_by_chance(len(keys), needed)]))
    index.add(keys)
    return OtherSearch(index)


def load_search(engine: str, directory: Path) -> KeySearch | OtherSearch:
    """Read a saved search."""
    if engine in ENGINES:
        return load_key_search(directory, SearchConfig().model_copy(update={"engine": engine}))
    return OtherSearch.load(directory)


def _flat(count: int, dimensions: int) -> faiss.Index:
    return faiss.IndexFlatL2(dimensions)


def _ivf(count: int, dimensions: int) -> faiss.Index:
    lists = max(1, count // KEYS_A_LIST)
    index = faiss.IndexIVFFlat(faiss.IndexFlatL2(dimensions), dimensions, lists, faiss.METRIC_L2)
    index.nprobe = min(lists, PROBES["faiss_ivf"])
    return index


def _ivf_pq(count: int, dimensions: int) -> faiss.Index:
    lists = max(1, min(count // KEYS_A_LIST, round(2 * math.sqrt(count))))
    parts = next(n for n in range(max(1, dimensions // PQ_NUMBERS), 0, -1) if dimensions % n == 0)
    index = faiss.IndexIVFPQ(faiss.IndexFlatL2(dimensions), dimensions, lists, parts, 8, faiss.METRIC_L2)
    index.use_precomputed_table = -1  # off: it would be larger than the codes
    index.pq.cp.niter = index.cp.niter = TRAINED_TURNS
    index.nprobe = min(lists, PROBES["faiss_ivf_pq"])
    index.cp.max_points_per_centroid, index.cp.min_points_per_centroid = 4 * TRAINED_KEYS_A_LIST, 1
    return index


def _hnsw(count: int, dimensions: int) -> faiss.Index:
    index = faiss.IndexHNSWFlat(dimensions, HNSW_LINKS, faiss.METRIC_L2)
    index.hnsw.efSearch = HNSW_SEARCH
    return index


OTHERS: dict[str, Callable[[int, int], faiss.Index]] = {
    "faiss_flat": _flat,
    "faiss_ivf": _ivf,
    "faiss_ivf_pq": _ivf_pq,
    "faiss_hnsw": _hnsw,
}
