"""Decoder of point_cloud_interfaces/CompressedPointCloud2, as ROS 2's point_cloud_transport sends it.

zstd and zlib pack the bytes of a PointCloud2. Draco packs its fields: of points that are equal one is left,
their order is another, and what its publisher quantised is coarser.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable
from functools import partial
from importlib.util import find_spec
from typing import Any

import numpy as np

from ..errors import MalformedData, UnsupportedFormat, pip_install
from ..formats.point_cloud import Column, Limits, PointCloud
from ..ros.header import Header, read_header
from ..ros.point_cloud2 import StampedCloud, decode_point_cloud2
from ..wire.content_encoding import unpack_zstd
from .clouds import Decode, check_axes
from .confined_process import ConfinedProcess
from .messages import RawMessage
from .struct_reader import StructReader

TYPE = "point_cloud_interfaces/msg/CompressedPointCloud2"
_NAME = "CompressedPointCloud2"
DRACO_LOSES = (
    "Draco packs with loss: of equal points one is left, coordinates may be rounded, float64 times are lost"
)
_MAX_FIELDS = 256
_MAX_WINDOW_BYTES = 1 << 27
_REPUBLISH = "ros2 run point_cloud_transport republish --ros-args -p in_transport:={0} -p out_transport:=raw"


def compressed_decoder(process: ConfinedProcess | None = None) -> Decode:
    """Make a decoder of clouds, see ``decode_compressed_cloud``.

    Args:
        process: in which DracoPy runs, which trusts sizes within the data; None: one of its own.
    """
    return partial(decode_compressed_cloud, process or ConfinedProcess())


def decode_compressed_cloud(process: ConfinedProcess, message: RawMessage, limits: Limits) -> StampedCloud:
    """Decode a cloud of the formats zstd, zlib and draco.

    Args:
        process: in which DracoPy runs.

    Raises:
        MalformedData: cut off, or the sizes contradict each other.
        TooLarge: over the limits.
        UnsupportedFormat: another format; the error names what unpacks it.
        ModuleNotFoundError: DracoPy is not installed.
    """
    reader = StructReader(_NAME, message.body, ros1=message.ros1)
    header = read_header(reader)
    height, width = reader.number("I"), reader.number("I")
    names = [_field_name(reader) for _ in range(reader.count(_MAX_FIELDS, "fields"))]
    reader.flag()
    point_step, row_step = reader.number("I"), reader.number("I")
    limits.check(_NAME, width * height, point_step)
    limits.check(_NAME, height, row_step)
    place = reader.place
    packed = reader.octets()
    is_dense = reader.flag()
    form = reader.text()
    reader.end()
    if form == "draco":
        return _of_draco(process, header, names, packed, limits)
    unpack = _UNPACK.get(form)
    if unpack is None:
        raise UnsupportedFormat(f"{_NAME}: no reader for its format {form[:40]!r}: {_remedy(form)}")
    data = unpack(packed, height * row_step)
    # A PointCloud2 is the same message up to the data. Its length is aligned already.
    begin = bytes(message.body[:place]) + bytes(-place % 4 if not message.ros1 else 0)
    plain = begin + struct.pack(reader.byte_order + "I", len(data)) + data + bytes([is_dense])
    return decode_point_cloud2(plain, limits, ros1=message.ros1)


def _field_name(reader: StructReader) -> str:
    name = reader.text()
    reader.number("I"), reader.number("B"), reader.number("I")
    return name


def _unzstd(packed: memoryview, size: int) -> bytes:
    return unpack_zstd(packed, size, _MAX_WINDOW_BYTES)


def _unzlib(packed: memoryview, size: int) -> bytes:
    stream = zlib.decompressobj()
    try:
        data = stream.decompress(packed, size + 1)
    except zlib.error as error:
        raise MalformedData(f"zlib: {error}") from error
    if len(data) > size or not stream.eof:
        raise MalformedData(f"zlib: not the {size} bytes that the cloud declares")
    return data


_DRACO_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 9: "f4", 10: "f8"}


# Magic, version, kind (0: points), method, flags, number of points. The library trusts the number.
_DRACO_HEAD = struct.Struct("<5s2sBBHi")
_HAS_METADATA = 0x8000  # which would stand before the number


def _check_draco(head: bytes, limits: Limits) -> None:
    if len(head) < _DRACO_HEAD.size or head[:5] != b"DRACO":
        raise MalformedData("draco: the data does not begin as Draco's")
    _, _, kind, _, flags, count = _DRACO_HEAD.unpack(head)
    if kind != 0 or flags & _HAS_METADATA or count < 0:
        raise MalformedData("draco: no cloud of points, or one with metadata")
    limits.check("draco", count, 12)


def _values(attribute: Any) -> Column | None:
    """The values of a Draco attribute in its own type; None: a colour, or of an unknown type.

    DracoPy 2.2 gives them as float32 and uint32. So of a float64 the last digits are lost: times since the
    epoch come out as one time, and so count as none.
    """
    values, form = np.asarray(attribute["data"]), _DRACO_TYPES.get(attribute["data_type"])
    if form is None or values.size != len(values) or values.dtype.kind not in "iuf":
        return None
    with np.errstate(invalid="ignore"):
        column: Column = values.reshape(-1).astype(form)
    return column


_UNPACK: dict[str, Callable[[memoryview, int], bytes]] = {"zstd": _unzstd, "zlib": _unzlib}


def _remedy(form: str) -> str:
    if form.startswith("cloudini"):
        return "cloudini_rosbag_converter (of cloudini_ros) writes a bag with PointCloud2 of it"
    return f"play the bag, and record what this sends: {_REPUBLISH.format(form[:40] or 'NAME')}"


def _draco_attributes(packed: bytes) -> dict[int, Column | None]:
    """The values of a Draco cloud's attributes by their numbers. It runs in a confined process."""
    import DracoPy

    try:
        decoded = DracoPy.decode(packed)
        return {int(one["unique_id"]): _values(one) for one in decoded.attributes}
    except Exception as error:  # its own, and those of NumPy, on damaged data
        raise MalformedData(f"draco: {str(error) or type(error).__name__}") from error


def _of_draco(
    process: ConfinedProcess, header: Header, names: list[str], packed: memoryview, limits: Limits
) -> StampedCloud:
    """The columns of a Draco cloud: of each field its publisher makes the attribute of its number."""
    if find_spec("DracoPy") is None:
        raise ModuleNotFoundError(
            f"clouds that Draco packed need the package DracoPy: {pip_install('.[draco]')}", name="DracoPy"
        )
    _check_draco(bytes(packed[: _DRACO_HEAD.size]), limits)
    attributes = process.run(_draco_attributes, bytes(packed))
    columns: dict[str, Column] = {}
    for number, name in enumerate(names):
        values = attributes.get(number)
        if values is not None:
            columns.setdefault(name, values)
    check_axes(_NAME, columns)
    limits.check(_NAME, len(columns["x"]), 8 * len(columns))
    if len({len(values) for values in columns.values()}) > 1:
        raise MalformedData("draco: its attributes have different numbers of values")
    return StampedCloud(header, PointCloud(columns), DRACO_LOSES)
