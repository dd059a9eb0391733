"""FAISS indexes by name.

Linear but fast: flat, 8 bits a number. Sublinear: inverted lists of whole keys, of 8 bits a number, of
product codes. And a graph.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import faiss
import numpy as np
from numpy.typing import NDArray

from ....bit_exact.sample import rows_by_chance

_L2 = faiss.METRIC_L2
FLAT_UP_TO = 250_000  # keys: reading so many takes a few milliseconds, and misses none
IVF_KEYS_A_LIST = 256
IVF_PROBES = 16
WIDE_PROBES = 128  # in indexes of short codes, for every PROBED_ROWS that are wanted
PROBED_ROWS = 400
TRAINED_KEYS_A_LIST = 64
TRAINED_TURNS = 10
HNSW_LINKS = 32
HNSW_SEARCH = 128
PQ_NUMBERS = 4  # of a key, in one byte of its code
PQ_FROM = 10_000  # keys: a byte has 256 values, each learned from about forty keys


def empty_index(engine: str, keys: NDArray[np.float32]) -> faiss.Index:
    """Returns an empty index, trained for (n, d) keys."""
    faiss.omp_set_num_threads(1)  # with several threads a graph's links would depend on their timing
    index = _INDEXES[chosen_engine(engine, len(keys))](*keys.shape)
    if not index.is_trained:
        index.train(_sample(keys, index))
    return index


def chosen_engine(engine: str, count: int) -> str:
    """Engine for so many keys: "auto" is resolved, and product codes are not learned below PQ_FROM keys."""
    if engine == "auto":
        return "faiss_sq8" if count <= FLAT_UP_TO else "faiss_ivf_sq8"
    return "faiss_sq8" if engine == "faiss_ivf_pq" and count < PQ_FROM else engine


def probes_for(index: faiss.IndexIVF, count: int) -> int:
    """Number of lists to search for so many rows."""
    times = 1 if isinstance(index, faiss.IndexIVFFlat) else -(-count // PROBED_ROWS)
    return int(min(index.nlist, times * index.nprobe))


def _sample(keys: NDArray[np.float32], index: faiss.Index) -> NDArray[np.float32]:
    """Keys to train an index: a part of them if lists are learned, as many as the lists need."""
    if not isinstance(index, faiss.IndexIVF):
        return keys
    needed = max(TRAINED_KEYS_A_LIST * index.nlist, PQ_FROM)
    return np.ascontiguousarray(keys[rows_by_chance(len(keys), needed)])


def _flat(count: int, dimensions: int) -> faiss.Index:
    return faiss.IndexFlat(dimensions, _L2)


def _sq8(count: int, dimensions: int) -> faiss.Index:
    return faiss.IndexScalarQuantizer(dimensions, faiss.ScalarQuantizer.QT_8bit, _L2)


def _ivf(count: int, dimensions: int) -> faiss.Index:
    lists = max(1, count // IVF_KEYS_A_LIST)
    index = faiss.IndexIVFFlat(faiss.IndexFlat(dimensions, _L2), dimensions, lists, _L2)
    index.nprobe = min(lists, IVF_PROBES)
    return index


def _ivf_sq8(count: int, dimensions: int) -> faiss.Index:
    lists = _lists(count)
    # not by residual: then a code is the same in every list, with the distances of "faiss_sq8"
    index = faiss.IndexIVFScalarQuantizer(
        faiss.IndexFlat(dimensions, _L2), dimensions, lists, faiss.ScalarQuantizer.QT_8bit, _L2, False
    )
    return _wide(index)


def _ivf_pq(count: int, dimensions: int) -> faiss.Index:
    lists = _lists(count)
    parts = next(n for n in range(max(1, dimensions // PQ_NUMBERS), 0, -1) if dimensions % n == 0)
    index = faiss.IndexIVFPQ(faiss.IndexFlat(dimensions, _L2), dimensions, lists, parts, 8, _L2)
    index.use_precomputed_table = -1  # off: it would be larger than the codes
    index.pq.cp.niter = TRAINED_TURNS
    return _wide(index)


def _wide(index: faiss.IndexIVF) -> faiss.IndexIVF:
    index.nprobe = min(index.nlist, WIDE_PROBES)
    index.cp.niter = TRAINED_TURNS
    index.cp.max_points_per_centroid = 4 * TRAINED_KEYS_A_LIST  # never the limit: the sample is
    index.cp.min_points_per_centroid = 1
    return index


def _lists(count: int) -> int:
    """Number of lists: enough for short lists, but few enough to compare a key with the centres of all.

    Every search does that, and every insertion of a key.
    """
    return max(1, min(count // IVF_KEYS_A_LIST, round(2 * math.sqrt(count))))


def _hnsw(count: int, dimensions: int) -> faiss.Index:
    index = faiss.IndexHNSWFlat(dimensions, HNSW_LINKS, _L2)
    index.hnsw.efSearch = HNSW_SEARCH
    return index


_INDEXES: dict[str, Callable[[int, int], faiss.Index]] = {
    "faiss_flat": _flat,
    "faiss_sq8": _sq8,
    "faiss_ivf": _ivf,
    "faiss_ivf_sq8": _ivf_sq8,
    "faiss_ivf_pq": _ivf_pq,
    "faiss_hnsw": _hnsw,
}
