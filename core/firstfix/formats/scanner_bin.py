"""Decoder of .bin files: numbers without a header, told apart by the name and by themselves."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..errors import MalformedData, UnsupportedFormat
from .point_cloud import Body, Limits, PointCloud
from .raw_xyz import decode_rows, decode_xyzi
from .row_layout import KITTI, LAYOUTS, is_too_small, may_have_rows_of_four, row_layout, row_length

NUSCENES = (*KITTI, "ring")
_CHOOSE = "Say what they are: --columns x,y,z,intensity,ring, with _ for a column to leave out"

_NCLT_RECORD = np.dtype([("x", "<u2"), ("y", "<u2"), ("z", "<u2"), ("intensity", "u1"), ("laser", "u1")])
_AVIA_RECORD = np.dtype(
    [(name, "<f4") for name in "xyz"]
    + [(name, "u1") for name in ("reflectivity", "tag", "line")]
    + [("offset", "<u4")]
)
_SAMPLED_ROWS = 1000
_PLAUSIBLE_M = 1e5  # larger than any range; most random bytes are not in it as float32


def decode_scanner_bin(
    body: Body, file_name: str, limits: Limits, columns: tuple[str, ...] | None = None
) -> PointCloud:
    """Decode rows of float32 (KITTI, nuScenes, Boreas and others), NCLT's records, or HeLiPR's Avia.

    A file whose name ends in ``.pcd.bin`` is nuScenes'. NCLT's frame (x forward, y right, z down) is changed
    to REP-103.

    Args:
        columns: the columns of the rows of float32, which then are not told by evidence.

    Raises:
        MalformedData: empty, or not a whole number of rows of the layout that the name implies.
        UnsupportedFormat: no layout fits, or several do; the error says which, and how to choose.
        TooLarge: over the limits.
    """
    if not len(body):
        raise MalformedData("bin: the file is empty (0 bytes)")
    if columns is not None:
        return decode_rows(body, columns, limits)
    name = file_name.lower()
    if name.endswith("velodyne_sync.bin"):
        return _decode_nclt(body, limits)
    if name.endswith(".pcd.bin"):
        return decode_rows(body, NUSCENES, limits)
    numbers = np.frombuffer(body, "<f4", len(body) // 4) if len(body) % 4 == 0 else None
    layout = None if numbers is None else row_layout(numbers)
    if layout is not None:
        found = decode_rows(body, layout.columns, limits, by_column=layout.by_column)
        if _are_plausible(_first_points(found)):
            return found
    if len(body) % _AVIA_RECORD.itemsize == 0:
        records = np.frombuffer(body, _AVIA_RECORD)
        limits.check("HeLiPR Avia", len(records), _AVIA_RECORD.itemsize)
        found = PointCloud({name: records[name] for name in _AVIA_RECORD.names or ()})
        if _are_plausible(_first_points(found)):
            return found
    if numbers is not None and layout is None and _may_be_kitti(numbers):
        return decode_xyzi(body, limits)
    raise UnsupportedFormat(_refusal(len(body), numbers))


def _may_be_kitti(numbers: NDArray[np.float32]) -> bool:
    """Whether rows of four are the only ones that fit, or the file is too small to tell."""
    if len(numbers) % 4 or not _are_plausible(numbers.reshape(-1, 4)[:_SAMPLED_ROWS, :3].T):
        return False
    if is_too_small(numbers):
        return True
    length = row_length(numbers)
    return length == 4 or (length is None and may_have_rows_of_four(numbers))


def _refusal(size: int, numbers: NDArray[np.float32] | None) -> str:
    none = "they are none of KITTI's, nuScenes' or Boreas' rows, HeLiPR's Avia or NCLT's *velodyne_sync.bin"
    if numbers is None:
        return f"bin: {size} bytes are not rows of float32: {none}"
    row = None if is_too_small(numbers) else row_length(numbers)
    if row is not None:
        return f"bin: rows of {row} numbers, whose columns are not known: {none}. {_CHOOSE}"
    rows = ", ".join(str(row) for row in LAYOUTS if len(numbers) % row == 0)
    fitting = f"rows of {rows} numbers each would fit" if rows else "no known rows fit"
    return f"bin: {size} bytes: {fitting}, and the numbers do not tell: {none}. {_CHOOSE}"


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


def _first_points(cloud: PointCloud) -> NDArray[np.float32]:
    """The first points, (3, n)."""
    return np.stack([cloud.columns[axis][:_SAMPLED_ROWS] for axis in "xyz"])


def _are_plausible(points: NDArray[np.float32]) -> bool:
    """Whether most of (3, n) points are NaN, 0 or of plausible size, and not denormal."""
    size = np.abs(points)
    with np.errstate(invalid="ignore"):
        good = np.isnan(size) | (size == 0) | ((size > 1e-6) & (size < _PLAUSIBLE_M))
    return np.count_nonzero(good[0] & good[1] & good[2]) > 0.95 * points.shape[1]
