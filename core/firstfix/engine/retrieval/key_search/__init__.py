"""Search engines for keys, chosen by name in the version's config (paper III.C, and FAISS)."""

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
    "faiss_sq8": FaissSearch,
    "faiss_ivf_sq8": FaissSearch,
}

__all__ = ["ENGINES", "FaissSearch", "KeySearch", "build_key_search", "load_key_search"]


def build_key_search(
    keys: NDArray[np.float32], config: SearchConfig, position_m: NDArray[np.floating] | None = None
) -> KeySearch:
    """Build the engine that the config names.

    Args:
        keys: (n, d).
        config: of the search.
        position_m: (n, 3) positions of the keys, to split them by tile; None: they are not split.
    """
    return ENGINES[config.engine].build(keys, config, position_m)


def load_key_search(directory: Path, config: SearchConfig) -> KeySearch:
    """Load the engine that the config names from a version's files.

    Raises:
        ValueError, RuntimeError, OSError: a file is missing or damaged, or belongs to another search.
    """
    return ENGINES[config.engine].load(directory, config)
