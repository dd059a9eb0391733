"""Decoder of .bin files of data sets. The name, the size and plausible numbers tell the layouts apart."""

from __future__ import annotations

import numpy as np

from ..errors import MalformedData, UnsupportedFormat
from .point_cloud import Body, Limits, PointCloud
from .raw_xyz import decode_xyzi

_NCLT_RECORD = np.dtype([("x", "<u2"), ("y", "<u2"), ("z", "<u2"), ("intensity", "u1"), ("laser", "u1")])
_AVIA_RECORD = np.dtype(
    [(name, "<f4") for name in "xyz"]
    + [(name, "u1") for name in ("reflectivity", "tag", "line")]
    + [("offset", "<u4")]
)
_SAMPLED_ROWS = 1000
_PLAUSIBLE_M = 1e5  # larger than any range; most random bytes are not in it as float32


def decode_scanner_bin(body: Body, file_name: str, limits: Limits) -> PointCloud:
    """Decode KITTI (float32 x y z intensity), NCLT's velodyne_sync, or HeLiPR's Avia.

    NCLT's frame (x forward, y right, z down) is changed to REP-103.

    Raises:
        MalformedData: empty, or not a whole number of rows of the layout that the name implies.
        UnsupportedFormat: no layout fits.
        TooLarge: over the limits.
    """
    if not len(body):
        raise MalformedData("bin: the file is empty (0 bytes)")
    if file_name.lower().endswith("velodyne_sync.bin"):
        return _decode_nclt(body, limits)
    if len(body) % 16 == 0 and _are_plausible(np.frombuffer(body, "<f4").reshape(-1, 4)[:, :3]):
        return decode_xyzi(body, limits)
    if len(body) % _AVIA_RECORD.itemsize == 0:
        records = np.frombuffer(body, _AVIA_RECORD)
        limits.check("HeLiPR Avia", len(records), _AVIA_RECORD.itemsize)
        if _are_plausible(np.stack([records[axis][:_SAMPLED_ROWS] for axis in "xyz"], axis=1)):
            return PointCloud({name: records[name] for name in _AVIA_RECORD.names or ()})
    raise UnsupportedFormat(
        f"bin: {len(body)} bytes are neither KITTI's rows (float32 x y z intensity) nor HeLiPR's Avia "
        "records, and the name is not NCLT's *velodyne_sync.bin. Save other rows, as nuScenes' of 20 "
        "bytes, with four numbers each"
    )


def _decode_nclt(body: Body, limits: Limits) -> PointCloud:
    if len(body) % _NCLT_RECORD.itemsize:
        raise MalformedData(
            f"NCLT: the file is cut off: {len(body)} bytes, records of {_NCLT_RECORD.itemsize}"
        )
    records = np.frombuffer(body, _NCLT_RECORD)
    limits.check("NCLT", len(records), 8 * 3)
    x, y, z = (records[axis] * 0.005 - 100.0 for axis in "xyz")
    return PointCloud(
        {"x": x, "y": -y, "z": -z, "intensity": records["intensity"], "laser": records["laser"]}
    )


def _are_plausible(points: np.ndarray[tuple[int, ...], np.dtype[np.float32]]) -> bool:
    """Whether most of the first (n, 3) points are NaN, 0 or of plausible size, and not denormal."""
    size = np.abs(points[:_SAMPLED_ROWS])
    with np.errstate(invalid="ignore"):
        good = np.isnan(size) | (size == 0) | ((size > 1e-6) & (size < _PLAUSIBLE_M))
    return bool(good.all(axis=1).mean() > 0.95)
