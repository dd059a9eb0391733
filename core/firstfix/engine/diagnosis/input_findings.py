"""Findings by a scan's own points: wrong columns, wrong units, driver faults, coordinates of a map."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...answer.scan_facts import ScanFacts
from ...findings import scan_kinds
from ...findings.finding import Finding
from ...scan.scan import Dropped
from .facts import is_intensity_first, is_on_a_line

MILLIMETRES_FROM_M = 2_000.0  # median range: LiDARs see 2 to 20 m in the median, indoors and outdoors
CENTIMETRES_FROM_M = 150.0
LARGEST_M = 1e7  # of millimetres, it would be 10 km: no unit makes ranges of it
ROBOT_M = 3.0  # all points of a scan lie nearer: it shows the robot only, or the unit is wrong
MAP_SPREAD = 0.2  # of the points, against their distance: they are far from the origin, not from each other
_WHOLE_NUMBERS = "the first has whole numbers, and none below 0"


def input_finding(
    facts: ScanFacts, part: NDArray[np.float32], dropped: Dropped = Dropped()
) -> Finding | None:
    """The cause why a scan cannot be used, as its own points show it, or None: it is not plain.

    Args:
        part: (m, 3) of its points, those of the facts.
        dropped: points that the scan does not have.
    """
    if is_intensity_first(part):  # before the units: intensities may be some hundred
        return scan_kinds.COLUMNS_SHIFTED.found(evidence=_WHOLE_NUMBERS)
    found = _by_ranges(facts, dropped)
    if found is None and is_on_a_line(part):
        return scan_kinds.TRANSPOSED.found()
    return found


def _by_ranges(facts: ScanFacts, dropped: Dropped) -> Finding | None:
    """The cause why most points cannot be used, or None: they can, or the cause is not plain."""
    if not facts.points:
        return scan_kinds.SCAN_EMPTY.found()
    median_m, largest_m = facts.median_range_m, facts.largest_range_m
    if largest_m is not None and 0 < largest_m < ROBOT_M:
        numbers = {"points": facts.points, "in_range": facts.in_range, "largest_range_m": largest_m}
        return scan_kinds.ALL_TOO_NEAR.found(numbers)
    if 2 * facts.in_range > facts.points - dropped.not_finite > 0:
        return None
    if 2 * dropped.too_far > facts.points - dropped.not_finite:
        median_m = dropped.far_m
    zero = facts.valid if largest_m == 0 else 0
    if median_m is None or (zero and not dropped.too_far):
        return scan_kinds.NOTHING_VALID.found(
            {"points": facts.points, "not_finite": dropped.not_finite, "zero": zero}
        )
    numbers = {"points": facts.points, "in_range": facts.in_range, "median_range_m": median_m}
    if median_m == dropped.far_m and dropped.spread_m < MAP_SPREAD * dropped.far_m:
        return scan_kinds.MAP_COORDINATES.found({**numbers, "spread_m": dropped.spread_m})
    if median_m > LARGEST_M:
        return scan_kinds.NO_COORDINATES.found(numbers)
    if median_m > MILLIMETRES_FROM_M:
        return scan_kinds.UNIT_MILLIMETRES.found(numbers)
    if median_m > CENTIMETRES_FROM_M:
        return scan_kinds.UNIT_CENTIMETRES.found(numbers)
    return None
