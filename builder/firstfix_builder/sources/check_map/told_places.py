"""Places of findings: a few of many, in the coordinates of the map's file, as numbers and in words."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

TOLD_PLACES, APART_M = 3, 5.0
MARKED_PLACES = 30  # in the report's picture

Place = tuple[float, float, float]


def marked(points: NDArray[np.floating], origin: NDArray[np.float64]) -> tuple[Place, ...]:
    """Some of (n, 3) points of a local frame, those with most to tell first, in the file's coordinates."""
    return tuple((x, y, z) for x, y, z in np.round(points[:MARKED_PLACES] + origin, 2).tolist())


def in_words(places: Sequence[Place]) -> str:
    """The first of them that are some metres apart."""
    told: list[Place] = []
    for place in places:
        if len(told) < TOLD_PLACES and all(math.dist(place, one) >= APART_M for one in told):
            told.append(place)
    return ", ".join(f"({x:.0f}, {y:.0f})" for x, y, _ in told)
