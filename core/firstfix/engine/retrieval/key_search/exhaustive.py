"""Exhaustive search: all distances. It is exact, and the reference for the other engines."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...config import SearchConfig
from .keys_file import load_keys, save_keys


class Exhaustive:
    """One matrix-vector product a query. Keys lie in 0..1: far from the origin, rounding would matter."""

    def __init__(self, keys: NDArray[np.float32]) -> None:
        self._keys = keys
        self._half_norm2 = np.einsum("nd,nd->n", keys, keys) / 2

    @classmethod
    def build(
        cls, keys: NDArray[np.float32], config: SearchConfig, position_m: NDArray[np.floating] | None = None
    ) -> Exhaustive:
        """Build the search over (n, d) keys."""
        return cls(keys)

    def __len__(self) -> int:
        return len(self._keys)

    def search(self, key: NDArray[np.float32], count: int) -> NDArray[np.int64]:
        """Rows of at most ``count`` keys near a (d,) key, nearest first."""
        return _least(self._half_norm2 - self._keys @ key, count)

    def search_among(
        self, key: NDArray[np.float32], rows: NDArray[np.integer], count: int
    ) -> NDArray[np.int64]:
        """The ``count`` nearest of (m,) ascending rows, or all of them."""
        nearest = _least(self._half_norm2[rows] - self._keys[rows] @ key, count)
        return rows[nearest].astype(np.int64)

    def codes(self) -> None:
        """None: the compiled cascade reads other keys."""

    def save(self, directory: Path) -> None:
        """Write the keys."""
        save_keys(self._keys, directory)

    @classmethod
    def load(cls, directory: Path, config: SearchConfig) -> Exhaustive:
        """Read the keys, memory-mapped."""
        return cls(load_keys(directory))


def _least(distance: NDArray[np.float32], count: int) -> NDArray[np.int64]:
    """Positions of the ``count`` smallest distances, smallest first."""
    if count >= len(distance):
        return np.argsort(distance, kind="stable")
    nearest = np.argpartition(distance, count)[:count]
    return nearest[np.argsort(distance[nearest], kind="stable")]
