"""What every key search does (paper III.C): nearest of n keys by L2 distance."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ...config import SearchConfig


class KeySearch(Protocol):
    """Built once, searched by many threads."""

    @classmethod
    def build(
        cls, keys: NDArray[np.float32], config: SearchConfig, position_m: NDArray[np.floating] | None = None
    ) -> KeySearch:
        """Of (n, d) keys, one or more, at (n, 3) places."""
        ...

    def __len__(self) -> int:
        """How many keys there are."""
        ...

    def search(self, key: NDArray[np.float32], count: int) -> NDArray[np.int64]:
        """(d,) key to at most ``count`` rows, nearest first."""
        ...

    def search_among(
        self, key: NDArray[np.float32], rows: NDArray[np.integer], count: int
    ) -> NDArray[np.int64]:
        """The ``count`` nearest, or all, of (m,) ascending rows: none is missed, whatever the engine."""
        ...

    def save(self, directory: Path) -> None:
        """Writes files whose names begin with ``keys``."""
        ...

    @classmethod
    def load(cls, directory: Path, config: SearchConfig) -> KeySearch:
        """What ``save`` wrote."""
        ...
