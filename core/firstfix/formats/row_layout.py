"""The layout of float32 rows without a header, by evidence: how long a row is, and what its columns are.

Neighbours in a row are different things, as x and y; neighbours in a column are the same thing of two points.
So numbers differ least at a distance of one row, in any order of the points. Of 400 real scans in ten layouts
and three orders, none is told wrong, and 35 of these 12,000 not at all (27 of them shuffled).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Numbers = NDArray[np.float32]
_ALIKE_M = 5.0  # numbers that differ by more are as unlike as any

KITTI: tuple[str, ...] = ("x", "y", "z", "intensity")
# By the length of a row: KITTI and most converters; nuScenes; those that keep times; Boreas;
# velodyne-decoder.
LAYOUTS: dict[int, tuple[tuple[str, ...], ...]] = {
    3: (("x", "y", "z"),),
    4: (KITTI,),
    5: ((*KITTI, "ring"), (*KITTI, "time")),
    6: ((*KITTI, "ring", "time"), (*KITTI, "time", "ring")),
    8: ((*KITTI, "time", "column", "ring", "return_type"),),
}
BY_COLUMN = KITTI  # Oxford's: all x, then all y, z and intensities
_FEWEST = 120  # numbers: fewer tell nothing
_QUICK, _THOROUGH = (4, 240), (24, 4096)  # chunks that are compared, and numbers in one
_CLEAR, _JUST_CLEAR = (
    0.9,
    0.97,
)  # of the difference at any other distance: by a quick look, and by a thorough one
_SAME = 1.15  # two rows differ as one does: the shorter row it is
_BY_TURNS = 0.8  # of the difference at other distances, that of a point and the next one of another beam
_BESIDE = (
    0.6  # of the difference at distance 1: from there, numbers next to each other are no different things
)
_MAX_RING = 255
_MAX_INTENSITY = 65_535
_MAX_TURN_S = 0.3  # from the first time to the last
_MAX_TIME_S = 1.0
MIN_ROW, _MAX_ROW = 3, 16


@dataclass(frozen=True)
class RowLayout:
    """How numbers are rows of points.

    Attributes:
        columns: their names.
        by_column: all numbers of a column stand together, in place of those of a row.
    """

    columns: tuple[str, ...]
    by_column: bool = False


def is_too_small(numbers: Numbers) -> bool:
    """Whether (n,) numbers are too few to tell anything."""
    return len(numbers) < _FEWEST


def row_layout(numbers: Numbers) -> RowLayout | None:
    """The layout that (n,) numbers show, or None: none, or none of the known ones."""
    count = len(numbers)
    if is_too_small(numbers):
        return None
    with np.errstate(invalid="ignore", over="ignore"):
        if count % 4 == 0 and _is_kitti(numbers):
            return RowLayout(KITTI)
        for row in (8, 6, 5):
            found = _named(numbers, row, "ring")
            if found is not None:
                return found
        if count % 4 == 0 and _is_by_column(numbers):
            return RowLayout(BY_COLUMN, by_column=True)
        length = row_length(numbers)
        return None if length is None else _named(numbers, length)


def _is_kitti(numbers: Numbers) -> bool:
    """Whether rows of four are plain at a quick look: nearly all files are such."""
    chunks = _chunks(numbers, *_QUICK)
    if not chunks[-1].min() < 0:  # may be intensities
        return False
    apart = {lag: _difference(chunks, lag, _ALIKE_M) for lag in (1, 3, 4, 5, 6, 8)}
    others = min(apart[1], apart[3], apart[5], apart[6])
    return apart[4] < _CLEAR * others and apart[4] <= _SAME * apart[8]


def _is_by_column(numbers: Numbers) -> bool:
    """Whether the last quarter of the numbers are intensities, and no rows of points."""
    parts = numbers.reshape(4, -1)
    if not parts[3].min() >= 0 or not all(part.min() < 0 for part in parts[:2]):
        return False
    chunks = _chunks(parts[3], *_QUICK)
    scale = float(np.median(chunks)) or 1.0  # no NaN: the least is a number
    beside = _difference(chunks, 1, scale)
    return min(_difference(chunks, row, scale) for row in LAYOUTS) >= _BESIDE * beside


def may_have_rows_of_four(numbers: Numbers) -> bool:
    """Whether (n,) numbers, of which no length of a row is plain, differ least at a distance of four.

    Numbers that stand for no return do not count. Where those beside each other differ least, they stand by
    column.
    """
    chunks = _chunks(numbers, *_THOROUGH)
    with np.errstate(invalid="ignore", over="ignore"):
        known = np.where(chunks == 0, np.float32(np.nan), chunks)
        apart = {lag: _difference_of_known(known, lag) for lag in range(1, _MAX_ROW + 1)}
    return apart[4] <= min(difference for lag, difference in apart.items() if lag % 4)


def row_length(numbers: Numbers) -> int | None:
    """How many of (n,) numbers make a row, by a thorough look; None: no length is plain."""
    chunks = _chunks(numbers, *_THOROUGH)
    sizes = np.abs(chunks[np.isfinite(chunks)])
    scale = 4 * float(np.median(sizes)) if len(sizes) else _ALIKE_M
    found = []
    for alike in (_ALIKE_M, scale):
        with np.errstate(invalid="ignore", over="ignore"):
            apart = {lag: _difference(chunks, lag, alike) for lag in range(1, _MAX_ROW + 1)}
        found += _clear_lengths(apart)[:1]
    return min(found)[1] if found else None


def _clear_lengths(apart: dict[int, float]) -> list[tuple[float, int]]:
    """The lengths at which numbers differ clearly less than at others, with the ratio: the shortest first.

    Several rows may differ least: where the points of some beams come by turns.
    """
    least = min((lag for lag in apart if lag >= MIN_ROW), key=lambda lag: apart[lag])
    clear = []
    for row in (row for row in range(MIN_ROW, least + 1) if least % row == 0):
        others = min(difference for lag, difference in apart.items() if lag % row)
        needed = _JUST_CLEAR if apart[row] <= _SAME * apart[least] else _BY_TURNS
        if apart[row] < needed * others:
            clear.append((apart[row] / others, row))
    return clear


def _named(numbers: Numbers, row: int, *needed: str) -> RowLayout | None:
    """The first known layout of rows of this length whose columns are what their names say."""
    found = names_of(numbers.reshape(-1, row), *needed) if len(numbers) % row == 0 else None
    return None if found is None else RowLayout(found)


def names_of(rows: NDArray[np.floating], *needed: str) -> tuple[str, ...] | None:
    """The names of the columns of (n, m) rows, these among them, where they are those of a known layout."""
    known = (names for names in LAYOUTS.get(rows.shape[1], ()) if set(needed) <= set(names))
    with np.errstate(invalid="ignore", over="ignore"):
        return next((names for names in known if _fits(rows, names)), None)


def _chunks(numbers: Numbers, count: int, length: int) -> Numbers:
    if len(numbers) <= count * length:
        return numbers[None, :]
    starts = np.arange(count) * (len(numbers) - length) // (count - 1)
    return np.stack([numbers[start : start + length] for start in starts])


def _difference(chunks: Numbers, lag: int, alike: float) -> float:
    """Mean difference of the numbers at this distance; NaN differs from all."""
    return float(np.fmin(np.abs(chunks[:, lag:] - chunks[:, :-lag]), np.float32(alike)).mean())


def _difference_of_known(chunks: Numbers, lag: int) -> float:
    """Mean difference of the numbers at this distance of which none is NaN; infinite without any."""
    found = np.abs(chunks[:, lag:] - chunks[:, :-lag])
    found = np.minimum(found[~np.isnan(found)], np.float32(_ALIKE_M))
    return float(found.mean()) if len(found) else np.inf


def _fits(rows: NDArray[np.floating], names: tuple[str, ...]) -> bool:
    """Whether the columns behind x, y and z are what their names say, where x is a number."""
    there = np.isfinite(rows[:, 0])
    columns = zip(names, rows.T, strict=True)
    return all(_CHECKS[name](column[there]) for name, column in columns if name in _CHECKS)


def _is_ring(column: NDArray[np.floating]) -> bool:
    return bool(
        len(column)
        and column.min() >= 0
        and 0 < column.max() <= _MAX_RING
        and (column == np.rint(column)).all()
    )


def _is_whole(column: NDArray[np.floating]) -> bool:
    return bool(len(column) and (column == np.rint(column)).all())


def _is_time(column: NDArray[np.floating]) -> bool:
    if not len(column) or not np.isfinite(column).all():
        return False
    return bool(0 < np.ptp(column) <= _MAX_TURN_S and max(-column.min(), column.max()) <= _MAX_TIME_S)


def _is_intensity(column: NDArray[np.floating]) -> bool:
    return bool(len(column) and column.min() >= 0 and column.max() <= _MAX_INTENSITY)


_CHECKS = {
    "ring": _is_ring,
    "time": _is_time,
    "intensity": _is_intensity,
    "column": _is_whole,
    "return_type": _is_whole,
}
