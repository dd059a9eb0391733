"""Intensity of a map's points, one byte each, for people who look at the map: no query reads it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from firstfix.bit_exact.sample import rows_by_chance
from firstfix.formats.point_cloud import Column

PERCENTILES = (2.0, 98.0)  # the ends of the scale: a few reflectors would make all else dark
STEPS = 255
_FAR = 1e30  # no sensor's number
_SAMPLED_POINTS = 100_000
_AT_ONCE = 1 << 20


@dataclass(frozen=True)
class Intensity:
    """Brightness of each point of a map.

    Attributes:
        values: (n,) uint8, from 0 for ``low`` to 255 for ``high``; what is beyond has these.
        low, high: in the source's own unit.
    """

    values: NDArray[np.uint8]
    low: float
    high: float

    @classmethod
    def of(cls, column: Column | None, kept: NDArray[np.bool_] | None = None) -> Intensity | None:
        """The intensity of a source's points; None: it has none, or the same for all of them.

        Args:
            column: (n,) in the source's own unit. What is no number counts as dark.
            kept: (n,) points that are in the map; None: all.
        """
        if column is None or not len(column):
            return None
        column = column if kept is None or kept.all() else column[kept]
        some = column[rows_by_chance(len(column), _SAMPLED_POINTS)].astype(np.float64)
        some = some[np.abs(some) < _FAR]
        if not len(some):
            return None
        low, high = np.percentile(some, PERCENTILES).tolist()
        if low == high:
            low, high = float(some.min()), float(some.max())
        if low == high:
            return None
        values = np.empty(len(column), np.uint8)
        for first in range(0, len(column), _AT_ONCE):
            part = slice(first, first + _AT_ONCE)
            with np.errstate(over="ignore", invalid="ignore"):
                share = (column[part].astype(np.float64) - low) / (high - low)
            values[part] = np.rint(STEPS * np.nan_to_num(np.clip(share, 0, 1), nan=0.0))
        return cls(values, low, high)

    def at(self, rows: NDArray[np.generic]) -> Intensity:
        """The intensity of some of the points, by a mask or by their rows."""
        return replace(self, values=self.values[rows])

    def save(self, path: Path) -> None:
        """Write a file ``.npz``."""
        np.savez(path, values=self.values, ends=np.array([self.low, self.high]))

    @classmethod
    def load(cls, path: Path) -> Intensity:
        """Load what ``save`` wrote."""
        with np.load(path) as file:
            return cls(file["values"], *file["ends"].tolist())


def as_column(points: NDArray[np.float64], intensity: Intensity | None) -> NDArray[np.float64]:
    """(n, 3) points with their brightness as a fourth column; (n, 3) where they have none."""
    return points if intensity is None else np.column_stack([points, intensity.values])


def from_column(
    rows: NDArray[np.float64], intensity: Intensity | None
) -> tuple[NDArray[np.float64], Intensity | None]:
    """The points (m, 3) of rows that were made of those of ``as_column``, and their intensity."""
    points = np.ascontiguousarray(rows[:, :3])
    if intensity is None:
        return points, None
    return points, replace(intensity, values=np.rint(rows[:, 3]).astype(np.uint8))


def joined_intensity(parts: Sequence[Intensity | None]) -> Intensity | None:
    """The intensity of several clouds as one, on a common scale; None: one of them has none."""
    known = [part for part in parts if part is not None]
    if not known or len(known) < len(parts):
        return None
    low, high = min(part.low for part in known), max(part.high for part in known)
    values = []
    for part in known:
        told = part.low + np.arange(STEPS + 1) * ((part.high - part.low) / STEPS)
        values.append(np.rint(STEPS * (told - low) / (high - low)).astype(np.uint8)[part.values])
    return Intensity(np.concatenate(values), low, high)
