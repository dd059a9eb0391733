"""The one place that decides which field of a cloud has the times of its points, and in which unit.

Drivers agree neither on the name, nor the type, nor the unit (docs/how-to/ros.md has their table). A name
makes a candidate; its numbers decide. From the first to the last point of a cloud is one turn of the LiDAR or
a part of it: 0.05 to 0.2 s of spinning ones (5 to 20 Hz), 0.1 s of most others. A thousand lies between two
units, so at most one of them makes a turn of the numbers. What is not plainly a turn is left out and named,
and not guessed.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..bit_exact.sample import rows_by_chance
from ..scan.scan import MAX_ABS_TIME_S
from ..scan.time_field import TimeField
from .point_cloud import Column

# Of Ouster, Livox, Velodyne, Hesai and RoboSense, Autoware, SICK, LAS, HeLiPR's Avia: by precedence.
TIME_NAMES = (
    *("t", "offset_time", "time", "timestamp", "time_stamp", "time_offset", "ts", "gps_time", "gpstime"),
    *("offset", "stamp"),
)
_SECONDS, _NANOSECONDS = "timesecond", "timenanosecond"  # one time in two fields: Hesai's SDK
_CLOUD_COMPARE = "scalar_"  # before the names of all fields that it does not know
_NAMED_UNIT = re.compile(r"[_ (](n|u|m|nano|micro|milli|)s(ec|econds?)?\)?$")
_PREFIXES = {"": "s", "n": "ns", "nano": "ns", "u": "us", "micro": "us", "m": "ms", "milli": "ms"}
_UNITS_S = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
TURN_S = (0.02, 0.25)  # half of a turn at 20 Hz; a turn at 5 Hz, which takes 0.2 s, with its jitter
_LONGEST_S = 2 * MAX_ABS_TIME_S
# Seconds and nanoseconds are what drivers write: short parts of a turn, and joined turns, are taken too.
# Fewer nanoseconds are those of one packet, or a turn in microseconds.
_USUAL_S = {"s": (1e-4, _LONGEST_S), "ns": (1e-3, _LONGEST_S)}
_SAMPLED = 1000  # points that are looked at for a unit which no driver writes by itself
_FILLED = 0.3  # of the span, the middle 90 % of the points: a few stray numbers are no turn
_MIN_LEVELS = 8  # different numbers in a turn: fewer are the rounding of a large number
_FINEST = 50  # steps of a float32 in a turn, at least
_MAX_WITHOUT = 0.01  # of the returns, whose time is NaN: each of them gets that of the point before
_EPOCH_S = 1e8  # later than this, a time counts from the epoch
_TODAY_S = (1e9, 4.1e9)  # since the epoch, of the years 2001 to 2099
_SHARES = ((0.0, 1.0), (-0.5, 0.5))  # as odometries scale the times of a turn
_COARSER = {"ms": "s", "us": "ms"}


@dataclass(frozen=True)
class PointTimes:
    """Times of a cloud's points, and the field that has them.

    Attributes:
        time_s: (n,) float32 seconds from the stamp; points that are no returns may have the first return's.
            None: not known.
        stamp_s: the cloud's own stamp; else the time of the first point, if it counts from the epoch; else
            None.
        field: the field that was taken; else the first that looks like times and was not understood; else
            None.
    """

    time_s: NDArray[np.float32] | None
    stamp_s: float | None
    field: TimeField | None = None


def is_time_name(name: str) -> bool:
    """Whether a field of this name may have the times of the points."""
    plain = _plain(name)
    return plain in TIME_NAMES or "time" in plain or "stamp" in plain


def point_times(columns: Mapping[str, Column], stamp_s: float | None) -> PointTimes:
    """The times of a cloud's points.

    The fields whose name may mean times are tried in the order of TIME_NAMES, and then others with ``time``
    or ``stamp`` in the name. The unit is the name's own (``time_offset_ns``), else that in which the
    numbers span a turn. Times since the epoch count from the stamp. Those that are not within
    MAX_ABS_TIME_S of it then, by the clock of another device, count from the first point. Points that are
    no returns, not finite or at the origin, do not vote.

    Args:
        columns: (n,) each, x, y and z among them, in any number types and byte order.
        stamp_s: of the cloud, in seconds since the epoch; None: not known.
    """
    usable: NDArray[np.bool_] | None = None
    failed: TimeField | None = None
    for name, column in _candidates(columns):
        found = _read(name, column, None, stamp_s)
        # most drivers give right times of all points; those by another clock count from the first return
        if found.time_s is None or (found.field is not None and found.field.clock == "own"):
            usable = _returns(columns) if usable is None else usable
            if not usable.any():
                break
            found = _read(name, column, usable, stamp_s)
        if found.time_s is not None:
            return found
        if failed is None or (failed.is_filling and found.field is not None):
            failed = found.field
    return PointTimes(None, stamp_s, failed)


def _candidates(columns: Mapping[str, Column]) -> Iterator[tuple[str, Column]]:
    """The columns of numbers whose names may mean times, by precedence."""
    by_name: dict[str, str] = {}
    for name, column in columns.items():
        if column.dtype.kind in "iuf":
            by_name.setdefault(name.lower().removeprefix(_CLOUD_COMPARE), name)
    if _SECONDS in by_name and _NANOSECONDS in by_name:
        first, second = by_name.pop(_SECONDS), by_name.pop(_NANOSECONDS)
        with np.errstate(over="ignore", invalid="ignore"):
            whole = columns[first].astype(np.int64) * 10**9 + columns[second].astype(np.int64)
        yield f"{first}+{second}", whole
    in_picture = {"t"} if "s" in by_name else set()  # s and t together are places in a picture
    known = [name for name in TIME_NAMES if name in by_name and name not in in_picture]
    others = [name for name in by_name if name not in TIME_NAMES and ("time" in name or "stamp" in name)]
    for name in (*known, *others):
        yield by_name[name], columns[by_name[name]]


def _plain(name: str) -> str:
    return name.lower().removeprefix(_CLOUD_COMPARE)


def _returns(columns: Mapping[str, Column]) -> NDArray[np.bool_]:
    """Of each point, whether it is a return: finite, and not at the origin."""
    x, y, z = (columns[axis] for axis in "xyz")
    with np.errstate(invalid="ignore", over="ignore"):  # any bits may stand in a message
        square = x * x
        square += y * y
        square += z * z
        found: NDArray[np.bool_] = (square > 0) & (square < np.inf)
    return found


def _read(name: str, column: Column, usable: NDArray[np.bool_] | None, stamp_s: float | None) -> PointTimes:
    """The times by one field, or why they are none.

    Args:
        usable: of each point, whether it is a return; None: all count.
    """
    if not len(column):
        return PointTimes(None, stamp_s)
    if usable is None or usable.all():
        usable = None
    with np.errstate(invalid="ignore", over="ignore"):
        taken = column if usable is None else column[usable]
        first, last = taken.min(), taken.max()
        without = 0.0
        if column.dtype.kind == "f" and not (np.isfinite(first) and np.isfinite(last)):
            column, without = _filled(column, np.ones(len(column), bool) if usable is None else usable)
            taken = column if usable is None else column[usable]
            first, last = taken.min(), taken.max()
    field = TimeField(name, column.dtype.name, float(first), float(last))
    unit, why = _unit_of(name, taken, first.item(), last.item())
    if without > _MAX_WITHOUT:
        unit, why = None, f"{without:.0%} of the points have none"
    if unit is None:
        return PointTimes(None, stamp_s, replace(field, why=why))
    scale = _UNITS_S[unit]
    span_s, first_s = (last.item() - first.item()) * scale, first.item() * scale
    clock = "epoch" if first_s > _EPOCH_S else "stamp"
    if clock == "epoch" and stamp_s is None:
        stamp_s = first_s
    begin_s = first_s - stamp_s if clock == "epoch" and stamp_s is not None else first_s
    if not (begin_s >= -MAX_ABS_TIME_S and begin_s + span_s <= MAX_ABS_TIME_S):
        begin_s, clock = 0.0, "own"
        if span_s > MAX_ABS_TIME_S:
            return PointTimes(None, stamp_s, replace(field, why=f"{span_s:.3g} s are more than a scan takes"))
    # From the first point, in the field's own numbers: nanoseconds since the epoch are finer than a float64.
    exact = column if column.dtype.kind in "iu" and column.dtype.itemsize >= 4 else column.astype(np.float64)
    with np.errstate(invalid="ignore", over="ignore"):
        time_s = (exact - first.astype(exact.dtype)) * scale
    if usable is not None:
        time_s = np.where(usable, time_s, 0.0)
    time_s += begin_s
    return PointTimes(time_s.astype(np.float32), stamp_s, replace(field, unit=unit, clock=clock))


def _filled(column: Column, usable: NDArray[np.bool_]) -> tuple[Column, float]:
    """The column with the number of the point before for each that is not finite, and the share of these."""
    has = np.isfinite(column) & usable
    without = 1 - np.count_nonzero(has) / np.count_nonzero(usable)
    if not has.any():
        return np.zeros_like(column), without
    before = np.maximum.accumulate(np.where(has, np.arange(len(column)), int(np.argmax(has))))
    return column[before], without


def _unit_of(name: str, taken: Column, first: float, last: float) -> tuple[str | None, str]:
    """The unit in which the numbers of the returns span a scan; or None, and why they do in none."""
    span = last - first
    if span == 0:
        return None, "all are equal"
    if taken.dtype.kind == "f" and taken.dtype.itemsize <= 4:
        step = float(np.spacing(np.float32(max(-first, last))))
        if span < _FINEST * step:
            return None, f"a float32 of this size has steps of {step:.3g}: too coarse for a turn"
    named = _NAMED_UNIT.search(_plain(name))
    if named:
        unit = _PREFIXES[named[1]]
        fits = _USUAL_S["s"][0] <= span * _UNITS_S[unit] <= _LONGEST_S
        return (unit, "") if fits else (None, f"{span * _UNITS_S[unit]:.3g} s are not the time of a scan")
    for unit, scale in _UNITS_S.items():
        least_s, most_s = _USUAL_S.get(unit, TURN_S)
        if unit == "s" and not (first >= _EPOCH_S or max(-first, last) <= MAX_ABS_TIME_S):
            most_s = TURN_S[1]  # a short part of a turn in milliseconds looks like more seconds
        if not least_s <= span * scale <= most_s or (unit == "s" and taken.dtype.kind in "iu"):
            continue
        if last * scale > _TODAY_S[1]:  # of a finer unit, with the span of a few points
            continue
        if unit in _USUAL_S:
            why = _why_no_turn(taken, first, last, span * scale)
            return (None, why) if why else (unit, "")
        coarser = first * _UNITS_S[_COARSER[unit]]
        if _TODAY_S[0] <= coarser <= _TODAY_S[1]:
            return (
                None,
                f"by the clock these are {span * _UNITS_S[_COARSER[unit]]:.3g} s, more than a scan takes",
            )
        if not _is_spread(taken, span):
            return None, "most of the points have nearly the same"
        if span == len(taken) - 1 and (np.diff(taken) == 1).all():
            return None, "they are the numbers of the points"
        return unit, ""
    return None, "in no unit they span a turn, or a part of one"


def _why_no_turn(taken: Column, first: float, last: float, span_s: float) -> str:
    """Why numbers that would be the seconds or nanoseconds of joined turns are none; empty: they may be."""
    if (first, last) in _SHARES:
        return f"{first:g} to {last:g} are shares of a turn, without its time"
    if span_s > TURN_S[1]:
        some = taken[rows_by_chance(len(taken), _SAMPLED)].astype(np.float64)
        middle = (some > first + (last - first) / 4) & (some < last - (last - first) / 4)
        if not middle.any():
            return "they are in two parts, as if they had begun anew"
    return ""


def _is_spread(taken: Column, span: float) -> bool:
    """Whether the numbers fill their span, as those of a turn do."""
    some = taken[rows_by_chance(len(taken), _SAMPLED)]
    low, high = np.quantile(some.astype(np.float64), (0.05, 0.95))
    return bool(high - low >= _FILLED * span and len(np.unique(some)) >= _MIN_LEVELS)
