"""Random samples of rows, the same for the same arguments.

Every k-th row is not a representative sample of an ordered list: rows that repeat with the period k are taken
either always or never. Examples are the beams of a scan, and the storeys of a column of viewpoints.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .accelerated import accelerated

_MIX_1, _MIX_2 = np.uint32(0x85EBCA6B), np.uint32(0xC2B2AE35)


@accelerated
def rows_by_chance(count: int, at_most: int) -> NDArray[np.int64]:
    """Ascending rows of a list: one random row of each of ``at_most`` equal runs.

    The result is the same on every machine (clients/protocol/on-the-robot.md).

    Args:
        count: length of the list.
        at_most: number of rows. A shorter list gives all its rows.
    """
    if count <= at_most:
        return np.arange(count)
    start = np.arange(at_most + 1) * count // at_most
    width = np.diff(start)
    hashes = hashed(np.arange(at_most, dtype=np.uint32)).astype(np.uint64)
    return start[:-1] + ((hashes * width.astype(np.uint64)) >> np.uint64(32)).astype(np.int64)


def hashed(x: NDArray[np.uint32]) -> NDArray[np.uint32]:
    """Hashes of 32 bits of (n,) numbers, in place: the last steps of MurmurHash3."""
    x ^= x >> np.uint32(16)
    x *= _MIX_1
    x ^= x >> np.uint32(13)
    x *= _MIX_2
    x ^= x >> np.uint32(16)
    return x
