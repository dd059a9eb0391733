"""Integers as planes of bytes of equal weight, side by side, so that zstd finds the runs."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def planes_of(numbers: NDArray[np.integer]) -> NDArray[np.uint8]:
    """(n,) little-endian integers to (bytes, n), least significant first."""
    return np.ascontiguousarray(
        np.ascontiguousarray(numbers).view(np.uint8).reshape(len(numbers), numbers.dtype.itemsize).T
    )


def joined(planes: NDArray[np.uint8], dtype: np.dtype[np.integer]) -> NDArray[np.integer]:
    """(bytes, n) planes, least significant first, to (n,) integers; missing planes are 0."""
    numbers = np.zeros((planes.shape[1], dtype.itemsize), np.uint8)
    for significance, plane in enumerate(planes):
        numbers[:, significance] = plane
    return numbers.view(dtype).ravel()
