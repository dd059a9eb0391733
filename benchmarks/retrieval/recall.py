"""Recall of described scans among described templates, and its time."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from firstfix.descriptor import Described, Descriptor, rows_of
from firstfix.engine.config import SearchConfig
from firstfix.engine.retrieval.key_search import build_key_search

from .described_world import Asked, Known

NEAREST = 400  # by key, whose templates are compared
FEW, SEVERAL = 10, 40
RIGHT_M, RIGHT_DEG = 0.75, 10.0
KEYS_AT_ONCE = 2000


@dataclass(frozen=True)
class Found:
    """One scan's templates after the comparison, the most alike first.

    Attributes:
        rows, yaw_rad: (k,) templates, and the scan's heading in each.
        right: (k,) whether place and heading are.
    """

    rows: NDArray[np.int64]
    yaw_rad: NDArray[np.floating]
    right: NDArray[np.bool_]


@dataclass(frozen=True)
class Recall:
    """Shares and times of one key.

    Attributes:
        numbers: of a key.
        key_10, key_all: share of the scans with a template of the right place among the 10, and among all
            that are compared, nearest by key.
        best_10, best_40: with the right place and heading among the best of the comparison.
        key_ms, compare_ms: medians, of one scan: key, projection and search; and comparison.
        found: of every scan.
    """

    numbers: int
    key_10: float
    key_all: float
    best_10: float
    best_40: float
    key_ms: float
    compare_ms: float
    found: list[Found]


def keys_of(descriptor: Descriptor, described: Described) -> NDArray[np.float32]:
    """In parts: the spectra of 100k templates at once do not fit."""
    count = len(next(iter(described.values())))
    parts = [slice(start, start + KEYS_AT_ONCE) for start in range(0, count, KEYS_AT_ONCE)]
    return np.concatenate([descriptor.keys(rows_of(described, part)) for part in parts])


def recall_of(
    descriptor: Descriptor,
    known: Known,
    asked: Asked,
    projection: NDArray[np.float32] | None,
    spacing_m: float,
    nearest: int = NEAREST,
) -> Recall:
    """Searched with the default engine.

    Args:
        projection: (d, numbers) for the keys; None: they are taken as they are.
        spacing_m: of the templates: so near one must lie to be right, or RIGHT_M if that is more.
    """
    keys = keys_of(descriptor, known.described)
    keys = keys if projection is None else keys @ projection
    engine = build_key_search(keys, SearchConfig())
    right = cKDTree(known.position_m).query_ball_point(asked.position_m, max(RIGHT_M, spacing_m))
    by_key, found, key_ms, compare_ms = [], [], [], []
    for number, here in enumerate(right):
        scan = rows_of(asked.described, slice(number, number + 1))
        began = time.perf_counter()
        key = descriptor.keys(scan)[0]
        rows = engine.search(key if projection is None else key @ projection, nearest)
        searched = time.perf_counter()
        yaw, score = descriptor.match(scan, known.described, rows)
        best = np.argsort(-score, kind="stable")
        compare_ms.append(1e3 * (time.perf_counter() - searched))
        key_ms.append(1e3 * (searched - began))
        is_here = np.isin(rows, here)
        off = np.abs((yaw - asked.yaw_rad[number] + np.pi) % (2 * np.pi) - np.pi)
        by_key.append(is_here)
        found.append(Found(rows[best], yaw[best], (is_here & (off <= np.radians(RIGHT_DEG)))[best]))
    return Recall(
        keys.shape[1],
        _share([one[:FEW] for one in by_key]),
        _share(by_key),
        _share([one.right[:FEW] for one in found]),
        _share([one.right[:SEVERAL] for one in found]),
        round(float(np.median(key_ms)), 2),
        round(float(np.median(compare_ms)), 1),
        found,
    )


def _share(flags: list[NDArray[np.bool_]]) -> float:
    return round(float(np.mean([one.any() for one in flags])), 3)
