"""Interface of a key search (paper III.C): nearest of n keys by L2 distance."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from ...config import SearchConfig

if TYPE_CHECKING:  # it loads faiss
    from .key_codes import KeyCodes


class KeySearch(Protocol):
    """Search engine for keys. Built once, searched by many threads."""

    @classmethod
    def build(
        cls, keys: NDArray[np.float32], config: SearchConfig, position_m: NDArray[np.floating] | None = None
    ) -> KeySearch:
        """Build the search over (n, d) keys, one or more, at (n, 3) positions."""
        ...

    def __len__(self) -> int:
        """Number of keys."""
        ...

    def search(self, key: NDArray[np.float32], count: int) -> NDArray[np.int64]:
        """Rows of at most ``count`` keys near a (d,) key, nearest first."""
        ...

    def search_among(
        self, key: NDArray[np.float32], rows: NDArray[np.integer], count: int
    ) -> NDArray[np.int64]:
        """The ``count`` nearest of (m,) ascending rows, or all of them. Every engine finds all."""
        ...

    def codes(self) -> KeyCodes | None:
        """Codes of all keys, for the compiled cascade; None: it has none in one list of 8-bit codes."""
        ...

    def save(self, directory: Path) -> None:
        """Write files whose names begin with ``keys``."""
        ...

    @classmethod
    def load(cls, directory: Path, config: SearchConfig) -> KeySearch:
        """Read what ``save`` wrote."""
        ...
