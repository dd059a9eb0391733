"""FAISS indexes of 8 bits a number, by name: all keys in one list, or in many that are probed."""

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
IVF_PROBES = 128  # for every PROBED_ROWS that are wanted
PROBED_ROWS = 400
TRAINED_KEYS_A_LIST = 64
TRAINED_TURNS = 10
MIN_TRAINED_KEYS = 10_000


def empty_index(engine: str, keys: NDArray[np.float32]) -> faiss.Index:
    """An empty index, trained for (n, d) keys."""
    faiss.omp_set_num_threads(1)  # with several, a learned centre would depend on their timing
    index = _INDEXES[chosen_engine(engine, len(keys))](*keys.shape)
    if not index.is_trained:
        index.train(_sample(keys, index))
    return index


def chosen_engine(engine: str, count: int) -> str:
    """Engine for so many keys: "auto" is resolved."""
    if engine == "auto":
        return "faiss_sq8" if count <= FLAT_UP_TO else "faiss_ivf_sq8"
    return engine


def probes_for(index: faiss.IndexIVF, count: int) -> int:
    """Number of lists to search for so many rows."""
    return int(min(index.nlist, -(-count // PROBED_ROWS) * index.nprobe))


def _sample(keys: NDArray[np.float32], index: faiss.Index) -> NDArray[np.float32]:
    """Keys to train an index: a part of them if lists are learned, as many as the lists need."""
    if not isinstance(index, faiss.IndexIVF):
        return keys
    needed = max(TRAINED_KEYS_A_LIST * index.nlist, MIN_TRAINED_KEYS)
    return np.ascontiguousarray(keys[rows_by_chance(len(keys), needed)])


def _sq8(count: int, dimensions: int) -> faiss.Index:
    return faiss.IndexScalarQuantizer(dimensions, faiss.ScalarQuantizer.QT_8bit, _L2)


def _ivf_sq8(count: int, dimensions: int) -> faiss.Index:
    lists = _lists(count)
    # not by residual: then a code is the same in every list, with the distances of "faiss_sq8"
    index = faiss.IndexIVFScalarQuantizer(
        faiss.IndexFlat(dimensions, _L2), dimensions, lists, faiss.ScalarQuantizer.QT_8bit, _L2, False
    )
    index.nprobe = min(index.nlist, IVF_PROBES)
    index.cp.niter = TRAINED_TURNS
    index.cp.max_points_per_centroid = 4 * TRAINED_KEYS_A_LIST  # never the limit: the sample is
    index.cp.min_points_per_centroid = 1
    return index


def _lists(count: int) -> int:
    """Number of lists: enough for short lists, but few enough to compare a key with the centres of all.

    Every search does that, and every insertion of a key.
    """
    return max(1, min(count // IVF_KEYS_A_LIST, round(2 * math.sqrt(count))))


_INDEXES: dict[str, Callable[[int, int], faiss.Index]] = {
    "faiss_sq8": _sq8,
    "faiss_ivf_sq8": _ivf_sq8,
}
