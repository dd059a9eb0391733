"""All distances, and the least of them: exact, and the measure of the others."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...config import SearchConfig
from .keys_file import load_keys, save_keys


class Exhaustive:
    """One matrix-vector product a query. Keys are shares, 0..1: far from the origin it would round."""

    def __init__(self, keys: NDArray[np.float32]) -> None:
        self._keys = keys
        self._half_norm2 = np.einsum("nd,nd->n", keys, keys) / 2

    @classmethod
    def build(
        cls, keys: NDArray[np.float32], config: SearchConfig, position_m: NDArray[np.floating] | None = None
    ) -> Exhaustive:
        return cls(keys)

    def __len__(self) -> int:
        return len(self._keys)

    def search(self, key: NDArray[np.float32], count: int) -> NDArray[np.int64]:
        return _least(self._half_norm2 - self._keys @ key, count)

    def search_among(
        self, key: NDArray[np.float32], rows: NDArray[np.integer], count: int
    ) -> NDArray[np.int64]:
        nearest = _least(self._half_norm2[rows] - self._keys[rows] @ key, count)
        return rows[nearest].astype(np.int64)

    def save(self, directory: Path) -> None:
        save_keys(self._keys, directory)

    @classmethod
    def load(cls, directory: Path, config: SearchConfig) -> Exhaustive:
        return cls(load_keys(directory))


def _least(further: NDArray[np.float32], count: int) -> NDArray[np.int64]:
    """Where the least of half the squared distances, less a constant, stand; the least first."""
    if count >= len(further):
        return np.argsort(further, kind="stable")
    nearest = np.argpartition(further, count)[:count]
    return nearest[np.argsort(further[nearest], kind="stable")]
