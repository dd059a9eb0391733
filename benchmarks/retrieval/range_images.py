"""Re-ranking by what the sensor would see from each of the best templates: a coarse range image."""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from firstfix.engine.preprocess import preprocess
from firstfix.scan.scan import Scan
from firstfix.scan.sequence import ScanSequence
from firstfix.transform import Matrix, rotation_z

from .described_world import DescribedWorld
from .recall import SEVERAL, Found

COLUMN_DEG, ROW_DEG = 6.0, 3.0
LOWEST_DEG, HIGHEST_DEG = -21.0, 21.0
TOLERANCE_M, TOLERANCE = 0.5, 0.1  # a template stands beside the scan: ranges that differ by less agree
AT = (1, 5, 10)

_COLUMNS = round(360 / COLUMN_DEG)
_ROWS = round((HIGHEST_DEG - LOWEST_DEG) / ROW_DEG)


def reranked(
    world: DescribedWorld, scans: Sequence[tuple[Scan, Matrix]], found: Sequence[Found]
) -> dict[str, dict[str, float]]:
    """Recall at AT of the best templates as they were found, and sorted by how many ranges agree."""
    before, after, ms = [], [], []
    for (scan, _), best in zip(scans, found, strict=True):
        prepared = preprocess(ScanSequence.single(scan), None, world.preprocess)
        assert prepared is not None
        seen = prepared.scans[0].batch.points
        rows, yaw, right = best.rows[:SEVERAL], best.yaw_rad[:SEVERAL], best.right[:SEVERAL]
        began = time.perf_counter()
        order = np.argsort(-_agreement(world, seen, prepared.scans[0].height_m, rows, yaw), kind="stable")
        ms.append(1e3 * (time.perf_counter() - began))
        before.append(right)
        after.append(right[order])
    spent = round(float(np.median(ms)), 1)
    return {"before": _recall(before) | {"rank_ms": 0.0}, "after": _recall(after) | {"rank_ms": spent}}


def _recall(right: Sequence[NDArray[np.bool_]]) -> dict[str, float]:
    return {f"best_{k}": round(float(np.mean([one[:k].any() for one in right])), 3) for k in AT}


def _agreement(
    world: DescribedWorld,
    points: NDArray[np.float32],
    height_m: float,
    rows: NDArray[np.int64],
    yaw_rad: NDArray[np.floating],
) -> NDArray[np.float64]:
    """(k,) share of the scan's cells whose range is that of the map, seen from each template at its yaw."""
    direction, away = _image(points)
    turns = np.stack([rotation_z(float(yaw)) for yaw in yaw_rad])
    origins = world.position_m[rows] + np.outer(height_m - world.height_m[rows], [0, 0, 1])
    towards = np.einsum("kij,cj->kci", turns, direction)
    from_there = np.broadcast_to(origins[:, None], towards.shape)
    cast = world.simulator.cast(from_there.reshape(-1, 3), towards.reshape(-1, 3)).reshape(len(rows), -1)
    agrees: NDArray[np.float64] = (np.abs(cast - away) <= TOLERANCE_M + TOLERANCE * away).mean(axis=1)
    return agrees


def _image(points: NDArray[np.float32]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """One return of every occupied cell, the one with the median range: (c, 3) direction and (c,) metres."""
    away = np.linalg.norm(points, axis=1).astype(np.float64)
    column = np.floor(np.degrees(np.arctan2(points[:, 1], points[:, 0])) / COLUMN_DEG).astype(int) % _COLUMNS
    row = np.floor((np.degrees(np.arcsin(points[:, 2] / away)) - LOWEST_DEG) / ROW_DEG).astype(int)
    kept = np.flatnonzero((row >= 0) & (row < _ROWS))
    cell = row[kept] * _COLUMNS + column[kept]
    order = np.lexsort((away[kept], cell))
    _, start, size = np.unique(cell[order], return_index=True, return_counts=True)
    middle = kept[order[start + size // 2]]
    return points[middle] / away[middle, None], away[middle]
