"""Decoder of sensor_msgs/PointCloud2: columns are NumPy views of the message."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import UnsupportedFormat
from ..formats.point_cloud import (
    INTENSITY_NAMES,
    RING_NAMES,
    Body,
    Column,
    Limits,
    PointCloud,
    axes_of,
    with_axes,
)
from ..formats.point_times import is_time_name, point_times
from ..scan.scan import Scan
from .cdr import MessageReader
from .header import Header, read_header

TYPE = "sensor_msgs/msg/PointCloud2"
_NAME = "PointCloud2"
_MAX_FIELDS = 256
_MAX_POINT_STEP = 65_535
_FLOAT_CODES = {7: "f4", 8: "f8"}
# The last three since ROS 2 Lyrical; a bool is a byte.
_CODES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", **_FLOAT_CODES, 9: "i8", 10: "u8", 11: "u1"}
_OTHER_NAMES = {"x", "y", "z", *INTENSITY_NAMES, *RING_NAMES}


@dataclass(frozen=True)
class StampedCloud:
    """The points of a message with their time and frame.

    Attributes:
        note: what the form of the message has lost, in words.
    """

    header: Header
    cloud: PointCloud
    note: str = ""

    def scan(self) -> Scan:
        """Make a scan. Points that are not finite are dropped, whatever ``is_dense`` says.

        Times of the points are those of ``point_times``.

        Raises:
            InvalidScan, TooLarge: as ``Scan.from_points``.
        """
        with np.errstate(invalid="ignore", over="ignore"):  # an intensity may be any float32
            x, y, z = (self.cloud.columns[axis] for axis in "xyz")
            stamp_s = self.header.stamp.seconds
            # a driver without a clock leaves the stamp 0
            times = point_times(self.cloud.columns, stamp_s or None)
            return Scan.from_columns(x, y, z, self.cloud.intensity, stamp_s, times.time_s, times.field)


@dataclass(frozen=True)
class _Field:
    name: str
    offset: int
    datatype: int
    count: int


def decode_point_cloud2(body: Body, limits: Limits, *, ros1: bool = False) -> StampedCloud:
    """Decode x, y, z, intensity, beams and times of a message in the message's number types.

    Fields may be in any order, with gaps. Rows may be padded (``row_step``). The numbers may be big-endian
    (``is_bigendian``), independent of the byte order of the CDR.

    Args:
        ros1: the packed form of a ROS 1 bag instead of CDR.

    Raises:
        MalformedData: the sizes contradict each other or the body, or the body is cut off.
        TooLarge: over the limits.
        UnsupportedFormat: not plain CDR, or x, y, z are not FLOAT32 or FLOAT64.
    """
    reader = MessageReader(_NAME, body, ros1=ros1)
    header = read_header(reader)
    height, width = reader.number("I"), reader.number("I")
    fields = [_read_field(reader) for _ in range(reader.count(_MAX_FIELDS, "fields"))]
    big_endian = reader.flag()
    point_step, row_step = reader.number("I"), reader.number("I")
    limits.check(_NAME, width * height, point_step)
    data = reader.octets()
    reader.flag()  # is_dense is ignored: points that are not finite are always searched
    reader.end()
    if len(data) != height * row_step or row_step < width * point_step or point_step > _MAX_POINT_STEP:
        reader.fail(
            f"{height} rows of {row_step} bytes with {width} points of {point_step} bytes contradict "
            f"{len(data)} bytes of data"
        )
    record = _record(reader, fields, point_step, ">" if big_endian else "<")
    rows = np.ndarray((height, width), record, data, strides=(row_step, point_step))
    columns = {name: _column(rows, name) for name in record.names or ()}
    return StampedCloud(header, PointCloud(with_axes(_NAME, columns)))


def _read_field(reader: MessageReader) -> _Field:
    return _Field(reader.text(), reader.number("I"), reader.number("B"), reader.number("I"))


def _record(reader: MessageReader, fields: list[_Field], point_step: int, order: str) -> np.dtype[np.void]:
    """The layout of a point. Of two fields with one name, the first one counts."""
    single: dict[str, _Field] = {}
    for field in fields:
        wanted = field.name.lower() in _OTHER_NAMES or is_time_name(field.name)
        if wanted and field.count == 1 and field.datatype in _CODES:
            single.setdefault(field.name, field)
    numbers = [field.name for field in fields if field.count == 1 and field.datatype in _CODES]
    for axis, name in axes_of(_NAME, numbers).items():
        if single[name].datatype not in _FLOAT_CODES:
            raise UnsupportedFormat(f"{_NAME}: {axis} is not FLOAT32 or FLOAT64")
    for field in single.values():
        if field.offset + np.dtype(_CODES[field.datatype]).itemsize > point_step:
            reader.fail(f"the field {field.name!r} is outside the {point_step} bytes of a point")
    return np.dtype(
        {
            "names": list(single),
            "formats": [order + _CODES[field.datatype] for field in single.values()],
            "offsets": [field.offset for field in single.values()],
            "itemsize": point_step,
        }
    )


def _column(rows: np.ndarray[tuple[int, int], np.dtype[np.void]], name: str) -> Column:
    """(n,) values: a view if the rows have no padding."""
    column: Column = rows[name].reshape(-1)
    return column
