"""Layouts of integers that zstd compresses well."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def planes_of(numbers: NDArray[np.integer]) -> NDArray[np.uint8]:
    """The planes of (n,) little-endian integers.

    Returns:
        (bytes, n): bytes of equal weight side by side, the least significant plane first.
    """
    return np.ascontiguousarray(numbers.view(np.uint8).reshape(len(numbers), numbers.dtype.itemsize).T)


def joined(planes: NDArray[np.uint8], dtype: np.dtype[np.integer]) -> NDArray[np.integer]:
    """The (n,) integers of (bytes, n) planes, least significant first. Missing planes are 0."""
    numbers = np.zeros((planes.shape[1], dtype.itemsize), np.uint8)
    numbers[:, : len(planes)] = planes.T
    return numbers.view(dtype).ravel()


def packed_halves(numbers: NDArray[np.uint8]) -> bytes:
    """Packs (n,) numbers below 16, two per byte, the first in the high bits; n is even."""
    return (numbers[::2] << 4 | numbers[1::2]).tobytes()


def halves_of(packed: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Unpack the (2 n,) numbers of the (n,) bytes of ``packed_halves``."""
    return np.stack([packed >> 4, packed & 15], axis=1).ravel()
