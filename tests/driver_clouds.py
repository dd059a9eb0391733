"""Clouds of a turning sensor as drivers write them: the fields, types, offsets and steps of their sources.

Each row is one layout. The table of docs/how-to/ros.md#times-of-points says which source was read for it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tests import ros_samples

Times = NDArray[np.float64]
PERIOD_S = 0.1
STAMP_NS = 1_730_000_000_250_000_000  # of the begin of the turn
_XYZ = [("x", "f4", 0), ("y", "f4", 4), ("z", "f4", 8)]
_IN_A_ROW = [*_XYZ, ("intensity", "f4", 12), ("ring", "u2", 16)]


@dataclass(frozen=True)
class Layout:
    """How one driver writes its points.

    Attributes:
        fields: name, type and offset of each.
        step: bytes of a point.
        times: columns of the times, of the seconds (n,) since the begin of the turn.
        stamp_s: what the driver stamps, in seconds since the begin of the turn.
        lost: coordinate of a beam without a return; its times are 0. None: the driver leaves it out.
        resolution_s: of the times.
        own_clock: the times are by another clock than the stamp, so that they count from the first point.
    """

    fields: list[tuple[str, str, int]]
    step: int
    times: Callable[[Times], Mapping[str, Times]]
    stamp_s: float = 0.0
    lost: float | None = None
    resolution_s: float = 2e-6
    own_clock: bool = False

    def truth_s(self, since_begin_s: Times) -> Times:
        """The times that a reader should find, in seconds from the stamp."""
        return since_begin_s - (float(since_begin_s.min()) if self.own_clock else self.stamp_s)

    def message(self, points: NDArray[np.float64], since_begin_s: Times) -> bytes:
        """A PointCloud2 as CDR, of (n, 3) points; every seventh beam has no return."""
        n = len(points)
        lost = np.zeros(n, bool)
        if self.lost is not None:
            points, since_begin_s = np.repeat(points, 2, axis=0), np.repeat(since_begin_s, 2)
            lost = np.arange(2 * n) % 14 == 1
            keep = lost | (np.arange(2 * n) % 2 == 0)
            points, since_begin_s, lost = points[keep], since_begin_s[keep], lost[keep]
        names, types, offsets = zip(*self.fields, strict=True)
        form = {"names": names, "formats": ["<" + one for one in types], "offsets": offsets}
        records = np.zeros(len(points), np.dtype({**form, "itemsize": self.step}))
        for axis, name in enumerate("xyz"):
            records[name] = np.where(lost, self.lost, points[:, axis])
        for name, values in self.times(since_begin_s).items():
            records[name] = np.where(lost, 0, values)
        for name in {"ring", "channel", "line"} & set(names):
            records[name] = np.arange(len(points)) % 16
        stamp_ns = STAMP_NS + round(self.stamp_s * 1e9)
        return ros_samples.cdr(ros_samples.cloud(records, stamp_ns=stamp_ns, frame_id="lidar"))


def _epoch_ns(t: Times) -> NDArray[np.int64]:
    return STAMP_NS + np.rint(t * 1e9).astype(np.int64)


def _epoch_s(t: Times) -> Times:
    return STAMP_NS / 1e9 + t


LAYOUTS = {
    # ouster-ros: beams without a return are at the origin
    "ouster": Layout(
        [*_XYZ, ("intensity", "f4", 16), ("t", "u4", 20), ("reflectivity", "u2", 24), ("ring", "u2", 26)]
        + [("ambient", "u2", 28), ("range", "u4", 32)],
        48,
        lambda t: {"t": t * 1e9},
        lost=0.0,
    ),
    # velodyne: stamped by its last packet
    "velodyne": Layout(
        [*_IN_A_ROW, ("time", "f4", 18)], 22, lambda t: {"time": t - PERIOD_S}, stamp_s=PERIOD_S
    ),
    "velodyne, stamped first": Layout([*_IN_A_ROW, ("time", "f4", 18)], 22, lambda t: {"time": t}),
    "hesai": Layout([*_IN_A_ROW, ("timestamp", "f8", 18)], 26, lambda t: {"timestamp": _epoch_s(t)}),
    # rslidar_sdk, XYZIRT: stamped by its last point, NaN kept
    "robosense": Layout(
        [*_IN_A_ROW, ("timestamp", "f8", 18)],
        26,
        lambda t: {"timestamp": _epoch_s(t)},
        stamp_s=PERIOD_S,
        lost=np.nan,
    ),
    "livox": Layout(
        [*_XYZ, ("intensity", "f4", 12), ("tag", "u1", 16), ("line", "u1", 17), ("timestamp", "f8", 18)],
        26,
        lambda t: {"timestamp": _epoch_ns(t).astype(np.float64)},
    ),
    "livox, not synchronised": Layout(
        [*_XYZ, ("intensity", "f4", 12), ("tag", "u1", 16), ("line", "u1", 17), ("timestamp", "f8", 18)],
        26,
        lambda t: {"timestamp": (t + 512.5) * 1e9},
        own_clock=True,
    ),
    # nebula, XYZIRCAEDT
    "nebula": Layout(
        [*_XYZ, ("intensity", "u1", 12), ("return_type", "u1", 13), ("channel", "u2", 14)]
        + [("azimuth", "f4", 16), ("elevation", "f4", 20), ("distance", "f4", 24), ("time_stamp", "u4", 28)],
        32,
        lambda t: {"time_stamp": t * 1e9},
    ),
    "autoware, XYZIRADRT": Layout(
        [*_XYZ, ("intensity", "f4", 16), ("ring", "u2", 20), ("azimuth", "f4", 24), ("distance", "f4", 28)]
        + [("return_type", "u1", 32), ("time_stamp", "f8", 40)],
        48,
        lambda t: {"time_stamp": _epoch_s(t)},
    ),
    "aeva": Layout(
        [*_XYZ, ("reflectivity", "f4", 12), ("velocity", "f4", 16), ("time_offset_ns", "i4", 20)]
        + [("line_index", "u1", 24), ("intensity", "f4", 25)],
        29,
        lambda t: {"time_offset_ns": t * 1e9},
    ),
    "sick, ts alone": Layout(
        [*_XYZ, ("intensity", "f4", 12), ("ts", "f4", 16), ("ring", "i1", 20)], 21, lambda t: {"ts": t}
    ),
    "sick, t and ts": Layout(
        [*_XYZ, ("i", "f4", 12), ("t", "u4", 16), ("ts", "f4", 20), ("layer", "i1", 24)],
        25,
        lambda t: {"t": t * 1e9, "ts": t},
    ),
    "unitree": Layout(
        [*_XYZ, ("intensity", "f4", 16), ("ring", "u2", 20), ("time", "f4", 24)], 32, lambda t: {"time": t}
    ),
    "seyond": Layout(
        [*_XYZ, ("timestamp", "f8", 16), ("intensity", "u2", 24), ("is_2nd_return", "u1", 26)],
        32,
        lambda t: {"timestamp": _epoch_s(t)},
    ),
    # ROS 2 Lyrical's codes, as PCL writes std::uint64_t and std::int64_t
    "uint64 since the epoch": Layout(
        [*_XYZ, ("intensity", "f4", 12), ("timestamp", "u8", 16)], 24, lambda t: {"timestamp": _epoch_ns(t)}
    ),
    "int64 before the stamp": Layout(
        [*_XYZ, ("intensity", "f4", 12), ("time_ns", "i8", 16)],
        24,
        lambda t: {"time_ns": (t - PERIOD_S) * 1e9},
        stamp_s=PERIOD_S,
    ),
    # FAST-LIO's timestamp_unit 1 and 2
    "microseconds": Layout([*_IN_A_ROW, ("time", "f4", 18)], 22, lambda t: {"time": t * 1e6}),
    "milliseconds before the stamp": Layout(
        [*_IN_A_ROW, ("time", "f4", 18)], 22, lambda t: {"time": (t - PERIOD_S) * 1e3}, stamp_s=PERIOD_S
    ),
    "milliseconds since the epoch": Layout(
        [*_IN_A_ROW, ("timestamp", "f8", 18)], 26, lambda t: {"timestamp": _epoch_s(t) * 1e3}
    ),
    "microseconds in uint64": Layout(
        [*_IN_A_ROW, ("timestamp", "u8", 18)], 26, lambda t: {"timestamp": _epoch_ns(t) // 1000}
    ),
    # filled by zeros, before the field that is meant
    "t of zeros": Layout(
        [*_IN_A_ROW, ("t", "u4", 18), ("timestamp", "f8", 22)], 30, lambda t: {"timestamp": _epoch_s(t)}
    ),
    # epoch times, and 0 for points at the origin
    "origin without a time": Layout(
        [*_IN_A_ROW, ("timestamp", "f8", 18)], 26, lambda t: {"timestamp": _epoch_s(t)}, lost=0.0
    ),
    "a lidar that is 37 s fast": Layout(
        [*_IN_A_ROW, ("timestamp", "f8", 18)],
        26,
        lambda t: {"timestamp": _epoch_s(t) + 37},
        own_clock=True,
    ),
}
