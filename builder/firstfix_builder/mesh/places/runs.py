"""Runs of equal rows in an ordered table."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def begins_run(rows: NDArray[np.int64]) -> NDArray[np.bool_]:
    """(n,) whether each of (n, k) rows differs from the one before. The first does."""
    begins = np.ones(len(rows), np.bool_)
    begins[1:] = (rows[1:] != rows[:-1]).any(axis=1)
    return begins


def rank_in_run(rows: NDArray[np.int64]) -> NDArray[np.int64]:
    """(n,) number of each of (n, k) rows within its run, from 0."""
    at = np.arange(len(rows))
    return at - np.maximum.accumulate(np.where(begins_run(rows), at, 0))
