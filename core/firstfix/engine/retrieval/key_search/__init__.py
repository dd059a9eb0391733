"""Search engines for keys, chosen by name in the version's config (paper III.C, and FAISS).

build_key_search  (n, d) keys to the engine that the config names
load_key_search   the same, from a version's files
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...config import SearchConfig
from .base import KeySearch
from .exhaustive import Exhaustive
from .faiss_search import FaissSearch
from .kd_tree import KdTree
from .lsh_kd_tree import LshKdTree

ENGINES: dict[str, type[KeySearch]] = {
    "auto": FaissSearch,
    "exhaustive": Exhaustive,
    "kdtree": KdTree,
    "lsh_kdtree": LshKdTree,
    "faiss_flat": FaissSearch,
    "faiss_sq8": FaissSearch,
    "faiss_ivf": FaissSearch,
    "faiss_ivf_sq8": FaissSearch,
    "faiss_ivf_pq": FaissSearch,
    "faiss_hnsw": FaissSearch,
}

__all__ = ["ENGINES", "KeySearch", "build_key_search", "load_key_search"]


def build_key_search(
    keys: NDArray[np.float32], config: SearchConfig, position_m: NDArray[np.floating] | None = None
) -> KeySearch:
    """
    Args:
        keys: (n, d).
        position_m: (n, 3) of the places that they stand for; None: they are not parted by tile.
    """
    return ENGINES[config.engine].build(keys, config, position_m)


def load_key_search(directory: Path, config: SearchConfig) -> KeySearch:
    """
    Raises:
        ValueError, RuntimeError, OSError: a file is missing, damaged, or of another search.
    """
    return ENGINES[config.engine].load(directory, config)
