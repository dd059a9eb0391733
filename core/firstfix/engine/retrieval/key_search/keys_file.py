"""File of plain keys, for engines that build their trees when a version is loaded."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

FILE = "keys.npy"


def save_keys(keys: NDArray[np.float32], directory: Path) -> None:
    """Write (n, d) keys."""
    np.save(directory / FILE, keys)


def load_keys(directory: Path) -> NDArray[np.float32]:
    """Keys (n, d), memory-mapped."""
    keys: NDArray[np.float32] = np.load(directory / FILE, mmap_mode="r")
    return keys


def nearest_of(
    keys: NDArray[np.floating], key: NDArray[np.float32], rows: NDArray[np.integer], count: int
) -> NDArray[np.int64]:
    """The ``count`` nearest of (m,) rows, nearest first, by computing every distance."""
    away = keys[rows] - key
    order = np.argsort(np.einsum("nd,nd->n", away, away), kind="stable")[:count]
    return rows[order].astype(np.int64)
