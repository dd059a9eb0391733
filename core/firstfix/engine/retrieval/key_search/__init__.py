"""Search engines for keys, chosen by name in the version's config (paper III.C, and FAISS)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...config import SearchConfig
from .base import KeySearch
from .exhaustive import Exhaustive
from .kd_tree import KdTree
from .lsh_kd_tree import LshKdTree

_OWN: dict[str, type[KeySearch]] = {"exhaustive": Exhaustive, "kdtree": KdTree, "lsh_kdtree": LshKdTree}
ENGINES = ("auto", *_OWN, "faiss_sq8", "faiss_ivf_sq8")

__all__ = ["ENGINES", "KeySearch", "build_key_search", "load_key_search"]


def build_key_search(
    keys: NDArray[np.float32], config: SearchConfig, position_m: NDArray[np.floating] | None = None
) -> KeySearch:
    """Build the engine that the config names.

    Args:
        keys: (n, d).
        config: of the search.
        position_m: (n, 3) positions of the keys, to split them by tile; None: they are not split.
    """
    return _engine(config.engine).build(keys, config, position_m)


def load_key_search(directory: Path, config: SearchConfig) -> KeySearch:
    """Load the engine that the config names from a version's files.

    Raises:
        ValueError, RuntimeError, OSError: a file is missing or damaged, or belongs to another search.
    """
    return _engine(config.engine).load(directory, config)


def _engine(name: str) -> type[KeySearch]:
    if name in _OWN:
        return _OWN[name]
    from .faiss_search import FaissSearch  # imported late: the process that listens searches no keys

    return FaissSearch
