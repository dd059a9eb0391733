"""The step of a map's coordinates: digits that were lost as float32, as text or by a scale."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from firstfix.bit_exact.sample import rows_by_chance
from firstfix.findings.finding import Finding
from firstfix.findings.map_kinds import MAP_DIGITS_FEW, MAP_DIGITS_LOST, MAP_FLOAT32, MAP_ROUNDED

LOST_M, ROUNDED_M = 0.1, 0.03  # steps of the coordinates: coarser than a map's points, than a LiDAR's noise
SHIFT_STEP_M = 1000.0
_SAMPLED_POINTS = 20_000
_STEPPED_SHARE = 0.98  # of the values: stray points may have other digits
_OFF_STEP = 0.02  # of a step: a product with a scale is not exact
# Voxels have a point each: no two points of a map of voxels are equal. Of rounded points many are.
# Points that were as far apart as the step or nearer share their place with another in a third and more: only
# then the step is coarser than the points were. A few twins are those of two maps of voxels that overlap.
_EQUAL_SHARE, _COARSER_SHARE = 0.005, 0.2
_COPIED_SHARE = 0.9  # of the places have equally many points: a map of voxels that is there several times
_DIGITS = (5, 7)  # of text with few digits: the step is so many powers of ten below the numbers


def check_precision(coordinates: NDArray[np.float64]) -> Finding | None:
    """Finding of (n, 3) coordinates of the file that lie on coarse steps."""
    sample = coordinates[rows_by_chance(len(coordinates), _SAMPLED_POINTS)]
    return _as_float32(sample) or _in_steps(sample, coordinates)


def _as_float32(sample: NDArray[np.float64]) -> Finding | None:
    """Finding of coordinates that all are float32 numbers, and too large for it."""
    single = sample.astype(np.float32)
    step_m = float(np.spacing(np.abs(np.median(single[:, :2], axis=0))).max())
    if step_m < ROUNDED_M or not np.array_equal(single.astype(np.float64), sample):
        return None
    if max(_step_of(values) for values in sample[:, :2].T) > 1.5 * step_m:
        return None  # fewer digits were left before
    numbers = {**_shift(sample), "largest_m": float(np.abs(sample).max()), "step_m": step_m}
    return (MAP_FLOAT32 if step_m >= LOST_M else MAP_ROUNDED).found(numbers)


def _in_steps(sample: NDArray[np.float64], coordinates: NDArray[np.float64]) -> Finding | None:
    """Finding of coordinates on steps along x or y that are no voxels."""
    steps_m = [_step_of(values) for values in sample.T]
    step_m = max(steps_m[:2])
    if step_m < ROUNDED_M:
        return None
    is_text = steps_m[2] < step_m / 2
    equal_share = _equal_share(coordinates)
    if not is_text and equal_share < _EQUAL_SHARE:
        return None
    axes = [axis for axis, step in zip("xyz", steps_m, strict=True) if step >= ROUNDED_M]
    largest_m = float(np.abs(sample).max())
    digits = int(np.log10(largest_m / step_m) + 1e-6) + 1
    if is_text and _DIGITS[0] <= digits <= _DIGITS[1]:
        cause, remedy = (
            f"they were written with {digits} digits",
            "Write all digits (C++: std::setprecision(12))",
        )
    else:
        cause, remedy = (
            "they were rounded when the file was written",
            "Export it with steps of 0.001 m (the scale of a LAS file)",
        )
    numbers = {**_shift(sample), "largest_m": largest_m, "step_m": step_m}
    words = {"axes": ", ".join(axes), "cause": cause, "export": remedy}
    is_lost = step_m > 1.01 * LOST_M and (is_text or equal_share >= _COARSER_SHARE)
    return (MAP_DIGITS_LOST if is_lost else MAP_DIGITS_FEW).found(numbers, **words)


def _step_of(values: NDArray[np.float64]) -> float:
    """The step on which (n,) values lie; 0: a finer one than matters, or none."""
    different = np.unique(values)
    if len(different) < 3 or len(different) * ROUNDED_M > 1.2 * np.ptp(different) + ROUNDED_M:
        return 0.0  # too many values for a coarse step
    apart = np.diff(different)
    step = float(np.quantile(apart[apart > 1e-6], 0.02)) if (apart > 1e-6).any() else 0.0
    if step < ROUNDED_M:
        return 0.0
    counted = (values - np.median(values)) / step
    on_step = np.abs(counted - np.round(counted)) < _OFF_STEP
    return step if on_step.mean() >= _STEPPED_SHARE else 0.0


def _equal_share(coordinates: NDArray[np.float64]) -> float:
    """Share of the points that have a twin at their place, in a compact part of the map."""
    order = np.argsort(coordinates[:, 0], kind="stable")
    half = len(order) // 2
    part = coordinates[order[max(0, half - _SAMPLED_POINTS) : half + _SAMPLED_POINTS]]
    _, count = np.unique(part, axis=0, return_counts=True)
    copied = np.count_nonzero(count == np.median(count)) / len(count)
    return 0.0 if copied >= _COPIED_SHARE and np.median(count) > 1 else 1 - len(count) / len(part)


def _shift(sample: NDArray[np.float64]) -> dict[str, float]:
    """The shift after which float32 would do."""
    x_m, y_m = (-np.round(np.median(sample[:, :2], axis=0) / SHIFT_STEP_M) * SHIFT_STEP_M).tolist()
    return {"shift_x_m": x_m, "shift_y_m": y_m}
