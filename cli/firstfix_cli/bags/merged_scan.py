"""One scan of the clouds of several LiDARs on one robot."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from firstfix.ros.point_cloud2 import StampedCloud
from firstfix.ros.static_transforms import StaticTransforms
from firstfix.scan.scan import Scan
from firstfix.transform import transform_points

_SAME_TIME_S = 1e-4  # a robot moves by less than the noise of a range


def merged_scan(
    clouds: Sequence[StampedCloud],
    frames: StaticTransforms,
    say: Callable[[str], None] = lambda line: None,
) -> Scan:
    """The scan of all clouds in the frame, and at the stamp, of the first one.

    Each point has its own time: that in its cloud; or, where no cloud has times, its cloud's stamp. So the
    motion of the robot from one LiDAR's cloud to the next is solved with the pose, like that within a
    cloud. Known times and unknown ones are not mixed: where a cloud has none and another has, the scan has
    none.

    The frame is a sensor's and not the robot's base, because a map's templates are views from where a sensor
    is. From a base frame on the floor another part of the world is seen.

    Args:
        say: called with a line about times that are left out.

    Raises:
        NotFound: a frame is not connected with the first, or the transforms run in a circle.
        MalformedData: the transforms between the frames contradict each other.
        InvalidScan, TooLarge: as ``Scan.from_points``.
    """
    first = clouds[0].header
    scans = [cloud.scan() for cloud in clouds]
    if len(scans) == 1:
        return scans[0]
    points = [
        transform_points(frames.between(first.frame_id, cloud.header.frame_id), scan.points)
        for cloud, scan in zip(clouds, scans, strict=True)
    ]
    intensities = [scan.intensity for scan in scans if scan.intensity is not None]
    lacking = _without_times(scans)
    if lacking is not None:
        say(_lacking_text(clouds[lacking], scans[lacking]))
    merged = Scan.from_points(
        np.concatenate(points),
        np.concatenate(intensities) if len(intensities) == len(scans) else None,
        scans[0].stamp_s,
        None if lacking is not None else _times(clouds, scans),
    )
    fields = [scan.time_field for scan in scans if scan.time_field is not None and scan.time_s is None]
    return replace(merged, time_field=fields[0] if fields else None)


def _without_times(scans: Sequence[Scan]) -> int | None:
    """The first of the scans that has no times, where another has them; else None."""
    has = [scan.time_s is not None for scan in scans]
    return has.index(False) if any(has) and not all(has) else None


def _lacking_text(cloud: StampedCloud, scan: Scan) -> str:
    field = scan.time_field
    why = "" if field is None else f" (the field {field.described} was not understood: {field.why})"
    return f"the clouds of {cloud.header.frame_id} have no times of their points{why}: times are not used"


def _times(clouds: Sequence[StampedCloud], scans: Sequence[Scan]) -> NDArray[np.float64] | None:
    """The (n,) times of the points from the first stamp, or None if all are of one time."""
    offsets = [_offset_s(clouds[0], cloud) for cloud in clouds]
    if all(scan.time_s is None for scan in scans) and max(map(abs, offsets)) < _SAME_TIME_S:
        return None
    return np.concatenate(
        [
            (np.zeros(len(scan)) if scan.time_s is None else scan.time_s.astype(np.float64)) + offset
            for scan, offset in zip(scans, offsets, strict=True)
        ]
    )


def _offset_s(first: StampedCloud, other: StampedCloud) -> float:
    begin, end = first.header.stamp, other.header.stamp
    return (end.ns - begin.ns) / 1e9 if begin.ns and end.ns else 0.0
