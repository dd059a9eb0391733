"""Holds keyframes out of a map that is made of scans: stretches of the drive, by seeded chance.

A scan that is in the map fits it too well. A map without a place that one scan alone saw lacks that place. So
keyframes are held out only where others saw the same.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from firstfix.bit_exact.sample import rows_by_chance

MIN_KEYFRAMES = 20
MAX_SHARE = 0.1  # of the keyframes
PARTS = 20
MIN_LENGTH = 2  # keyframes of a part, if there are enough: a single one has its double beside it
SEED = 17
TRIES = 50  # places that are drawn for each part

SEEN_M, SEEN_SHARE = 0.3, 0.9  # so many of a scan's points have one of the map this near
NEAR_M = 5.0  # from a held-out keyframe to one of the map: beyond it, the map need not have a template there
COMPARED_POINTS = 2000

FEW = f"the map has fewer than {MIN_KEYFRAMES} keyframes"
ALONE = "no other keyframe saw what they see"
FAR = f"no other keyframe is within {NEAR_M:g} m"


@dataclass(frozen=True)
class HeldOutParts:
    """Counts of the keyframes that were held out of a map that is made of its scans.

    Attributes:
        keyframes: number that the map was made without.
        parts: number of stretches of the drive that they make up.
        kept_out: by reason, number of keyframes that the map needs, or that are too few.
    """

    keyframes: int = 0
    parts: int = 0
    kept_out: Mapping[str, int] = field(default_factory=dict)

    def to_mapping(self) -> dict[str, object]:
        """The numbers as JSON values."""
        return asdict(self)


def drawn_parts(positions: NDArray[np.float64], most: int, seed: int = SEED) -> list[range]:
    """Draw parts of a drive: places by chance along the way, so that a stop counts as one place.

    Args:
        positions: (n, 3) metres, of the keyframes in the order of the drive.
        most: number of keyframes in all parts together; a tenth of all if that is less.

    Returns:
        Ascending ranges of keyframes, at least one keyframe between two of them; none of too few keyframes.
    """
    count = len(positions)
    wanted = min(most, int(MAX_SHARE * count)) if count >= MIN_KEYFRAMES else 0
    if not wanted:
        return []
    number = min(PARTS, -(-wanted // MIN_LENGTH))
    lengths = [len(part) for part in np.array_split(np.arange(wanted), number)]
    steps_m = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    way_m = np.append(0.0, np.cumsum(steps_m))
    rng = np.random.default_rng(seed)
    taken, found = np.zeros(count + 1, np.bool_), []
    for length in lengths:
        for place_m in rng.uniform(0.0, way_m[-1], TRIES):
            start = int(np.searchsorted(way_m, place_m))
            part = range(start, start + length)
            if part.stop <= count and not taken[max(0, start - 1) : part.stop + 1].any():
                taken[start : part.stop] = True
                found.append(part)
                break
    return sorted(found, key=lambda part: part.start)


class OtherKeyframes:
    """The cloud of the keyframes that are surely in the map: a candidate is held out if they saw the same.

    Args:
        points: (n, 3) metres, their joined cloud.
        positions: (k, 3) where they were taken.
    """

    def __init__(self, points: NDArray[np.float64], positions: NDArray[np.float64]) -> None:
        self._points = cKDTree(points, balanced_tree=False, compact_nodes=False)
        self._positions = cKDTree(positions)

    def why_kept(self, points: NDArray[np.float64], position: NDArray[np.float64]) -> str | None:
        """Reason why the map needs a scan; None: it can do without.

        Args:
            points: (m, 3) of the scan, in the frame of the cloud.
            position: (3,) of its sensor.
        """
        if self._positions.query(position)[0] > NEAR_M:
            return FAR
        some = points[rows_by_chance(len(points), COMPARED_POINTS)]
        if not len(some):
            return ALONE
        away_m = self._points.query(some, distance_upper_bound=SEEN_M)[0]  # inf beyond the bound
        return ALONE if np.isfinite(away_m).mean() < SEEN_SHARE else None
