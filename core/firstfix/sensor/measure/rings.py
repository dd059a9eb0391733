"""The rings of scans: which points one beam has seen, by the format's field, the order, or the elevation."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Way = Literal["field", "order", "elevation"]

MAX_RINGS = 512  # as in a SensorModel
_MIN_OF_RING = 5  # points
_MIN_IN_ORDER = 8  # turns: fewer come by chance, where the azimuth jumps
_SPREAD_SHARE = {"field": 0.6, "order": 1.0}  # of the gap between rings; without rings it is several gaps
_JUMP_SHARE = 0.2  # of the gap: from point to point of a ring in the order of the file
_LENS_M = 5.0  # nearer than this, beams that do not come from one point have another elevation
_WIDTHS_DEG = (0.3, 0.15, 0.08, 0.04, 0.02)
_VALLEY = 0.4  # of the lower one of two peaks: a higher valley does not part them
_SHALLOW_VALLEY = 0.25  # the median of rings
_NEAR_PEAK, _NEAR_SHARE = 0.2, 0.8  # of the gap, and share of the points so near; without rings, it is 0.4
_AS_GOOD = 0.03
_WEAK_PEAK = 0.02  # of the median peak


@dataclass(frozen=True)
class Rings:
    """Rings of one scan or several.

    Attributes:
        elevations_deg: (r,) ascending.
        of_point: (n,) number of each point's ring, -1: none.
        way: how they were found.
    """

    elevations_deg: NDArray[np.float64]
    of_point: NDArray[np.intp]
    way: Way

    def __len__(self) -> int:
        return len(self.elevations_deg)


def rings_by_field(
    elevation_deg: NDArray[np.float64], range_m: NDArray[np.float64], field: NDArray[np.integer]
) -> Rings | None:
    """Rings as the format numbers them, (n,) each; None: the numbers are not of beams (a Livox's lines)."""
    numbers, of_point = np.unique(field, return_inverse=True)
    if len(numbers) > MAX_RINGS:
        return None
    return _checked(elevation_deg, range_m, of_point, "field")


def rings_by_order(
    elevation_deg: NDArray[np.float64], range_m: NDArray[np.float64], azimuth_rad: NDArray[np.float64]
) -> Rings | None:
    """Rings of a file that holds one after the other, (n,) each: the azimuth goes full circle; else None.

    KITTI has such files. Its lasers do not sit in one point, so elevation alone would mix them.
    """
    jump_deg = float(np.median(np.abs(np.diff(elevation_deg))))  # small along a ring
    for cut in (0.0, np.pi, float(azimuth_rad[0])):
        turn = (azimuth_rad - cut) % (2 * np.pi)
        of_point = np.concatenate([[0], np.cumsum(np.abs(np.diff(turn)) > np.pi)])
        if _MIN_IN_ORDER <= of_point[-1] + 1 <= MAX_RINGS:
            found = _checked(elevation_deg, range_m, of_point, "order")
            if found is not None and jump_deg < _JUMP_SHARE * np.median(np.diff(found.elevations_deg)):
                return found
    return None


def rings_by_elevation(elevation_deg: NDArray[np.float64], range_m: NDArray[np.float64]) -> Rings | None:
    """Rings as peaks of the elevation's density, (n,) each; None: it has none.

    The width of smoothing that tells them best is taken; the widest of those as good.
    """
    far = range_m > _LENS_M
    best: tuple[float, NDArray[np.float64], NDArray[np.float64]] | None = None
    for used in (elevation_deg, elevation_deg[far]) if far.mean() > 0.5 else (elevation_deg,):
        for width_deg in _WIDTHS_DEG:
            parts = _parts(used, width_deg)
            near = 0.0 if parts is None else _share_near(used, parts)
            if parts is not None and near >= _NEAR_SHARE and (best is None or near > best[0] + _AS_GOOD):
                best = near, used, parts
    if best is None:
        return None
    _, used, parts = best
    elevations = _medians(used, np.searchsorted(parts, used), len(parts) + 1)
    return Rings(elevations, np.searchsorted(parts, elevation_deg), "elevation")


def _checked(
    elevation_deg: NDArray[np.float64], range_m: NDArray[np.float64], of_point: NDArray[np.intp], way: Way
) -> Rings | None:
    """The rings in the order of their elevations, or None if their points spread too much."""
    count = np.bincount(of_point)
    enough = count >= max(_MIN_OF_RING, _WEAK_PEAK * np.median(count))
    number = np.where(enough, np.cumsum(enough) - 1, -1)[of_point]
    rings = int(enough.sum())
    if rings < 2:
        return None
    far = (range_m > _LENS_M) & (number >= 0)
    seen = np.bincount(number[far], minlength=rings)
    usable = np.where(seen[number] >= _MIN_OF_RING, far, number >= 0)
    usable &= number >= 0
    elevations = _medians(elevation_deg[usable], number[usable], rings)
    off = np.abs(elevation_deg - elevations[number])
    spread = _medians(off[usable], number[usable], rings)
    order = np.argsort(elevations)
    gap = float(np.median(np.diff(elevations[order])))
    if not float(np.median(spread)) < _SPREAD_SHARE[way] * gap:
        return None
    rank = np.empty(rings, np.intp)
    rank[order] = np.arange(rings)
    return Rings(elevations[order], np.where(number >= 0, rank[number], -1), way)


def _medians(values: NDArray[np.float64], group: NDArray[np.intp], groups: int) -> NDArray[np.float64]:
    """(groups,) median of the values in each group, none of them empty."""
    order = np.lexsort((values, group))
    ends = np.cumsum(np.bincount(group, minlength=groups))
    starts = np.concatenate([[0], ends[:-1]])
    low, high = values[order][(starts + ends - 1) // 2], values[order][(starts + ends) // 2]
    middle: NDArray[np.float64] = (low + high) / 2
    return middle


def _parts(elevation_deg: NDArray[np.float64], width_deg: float) -> NDArray[np.float64] | None:
    """(r - 1,) elevations that part r peaks of the density; None: fewer than 2, too many, or shallow ones."""
    step = width_deg / 3
    low = float(elevation_deg.min()) - 5 * width_deg
    bins = int(np.ceil((float(elevation_deg.max()) + 5 * width_deg - low) / step))
    count = np.bincount(((elevation_deg - low) / step).astype(np.intp), minlength=bins).astype(np.float64)
    reach = np.arange(-9, 10)
    kernel = np.exp(-0.5 * (reach / 3) ** 2)
    density = np.convolve(count, kernel / kernel.sum(), mode="same")
    peaks = _peaks(density)
    if not 2 <= len(peaks) <= MAX_RINGS:
        return None
    valleys = [first + int(np.argmin(density[first:second])) for first, second in pairwise(peaks)]
    lower = np.minimum(density[peaks[:-1]], density[peaks[1:]])
    if float(np.median(density[valleys] / lower)) > _SHALLOW_VALLEY:
        return None
    return low + (np.array(valleys) + 0.5) * step


def _peaks(density: NDArray[np.float64]) -> list[int]:
    """Places of the peaks with a deep valley between any two."""
    rises = np.flatnonzero((density[1:-1] > density[:-2]) & (density[1:-1] >= density[2:])) + 1
    if not len(rises):
        return []
    floor = _WEAK_PEAK * float(np.median(np.sort(density[rises])[-max(1, len(rises) // 2) :]))
    kept: list[int] = []
    for place in (int(rise) for rise in rises if density[rise] >= floor):
        while kept:
            valley = float(density[kept[-1] : place].min())
            if valley < _VALLEY * min(density[kept[-1]], density[place]):
                kept.append(place)
                break
            if density[kept[-1]] >= density[place]:
                break
            kept.pop()
        else:
            kept.append(place)
    return kept


def _share_near(elevation_deg: NDArray[np.float64], parts: NDArray[np.float64]) -> float:
    """Share of points nearer to their ring's median than a part of the gap to the next ring."""
    group = np.searchsorted(parts, elevation_deg)
    if np.bincount(group, minlength=len(parts) + 1).min() < _MIN_OF_RING:
        return 0.0
    middles = _medians(elevation_deg, group, len(parts) + 1)
    gaps = np.diff(middles)
    gap = np.minimum(np.concatenate([[np.inf], gaps]), np.concatenate([gaps, [np.inf]]))
    return float((np.abs(elevation_deg - middles[group]) < _NEAR_PEAK * gap[group]).mean())
