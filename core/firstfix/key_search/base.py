"""What every key search does (paper III.C): nearest of n keys by L2 distance."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ..engine_config import SearchConfig


class KeySearch(Protocol):
    """Built once, searched by many threads."""

    @classmethod
    def build(cls, keys: NDArray[np.float32], config: SearchConfig) -> KeySearch:
        """Of (n, d) keys, one or more."""
        ...

    def search(self, key: NDArray[np.float32], count: int) -> NDArray[np.int64]:
        """(d,) key to at most ``count`` rows, nearest first."""
        ...

    def save(self, directory: Path) -> None:
        """Writes files whose names begin with ``keys``."""
        ...

    @classmethod
    def load(cls, directory: Path, config: SearchConfig) -> KeySearch:
        """What ``save`` wrote."""
        ...
