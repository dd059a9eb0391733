"""Decoder of foxglove.PointCloud in protobuf, by the schema that the recording holds.

https://docs.foxglove.dev/docs/sdk/schemas/point-cloud. Its codes of numbers are not those of ROS: the types
of integers with and without a sign are swapped.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ..errors import FirstfixError, MalformedData, UnsupportedFormat, pip_install
from ..formats.point_cloud import SCAN_LIMITS, Limits, PointCloud
from ..ros.header import Header, Stamp
from ..ros.point_cloud2 import StampedCloud
from ..transform import Matrix, from_quaternion, transform_points
from .clouds import check_axes
from .messages import RawMessage

TYPE = "foxglove.PointCloud"
_CODES = {1: "u1", 2: "i1", 3: "u2", 4: "i2", 5: "u4", 6: "i4", 7: "f4", 8: "f8"}
_MAX_FIELDS = 256
_MAX_POINT_STEP = 65_535


def foxglove_decoder(schema: bytes) -> Callable[[RawMessage, Limits], StampedCloud]:
    """Make the decoder of a recording's messages.

    Args:
        schema: the FileDescriptorSet of its channel.

    Raises:
        MalformedData: not such a schema.
        ModuleNotFoundError: protobuf is not installed.
    """
    try:
        from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            f"clouds in protobuf need the package protobuf: {pip_install('.[service]')}", name=error.name
        ) from error
    try:
        pool = descriptor_pool.DescriptorPool()
        for file in descriptor_pb2.FileDescriptorSet.FromString(schema).file:
            pool.Add(file)
        kind = message_factory.GetMessageClass(pool.FindMessageTypeByName(TYPE))
    except Exception as error:  # protobuf has several, and a schema of a stranger may raise any
        raise MalformedData(f"the schema of {TYPE}: {error}") from error

    def decode(message: RawMessage, limits: Limits) -> StampedCloud:
        try:
            return _cloud(kind.FromString(bytes(message.body)), limits)
        except FirstfixError:
            raise
        except Exception as error:
            raise MalformedData(f"{TYPE}: {error}") from error

    return decode


def header_of(decode: Callable[[RawMessage, Limits], StampedCloud], message: RawMessage) -> Header:
    """Time and frame of a message: fields of protobuf have no order, so it is read as a whole."""
    return decode(message, SCAN_LIMITS).header


def _cloud(message: Any, limits: Limits) -> StampedCloud:
    stride, data = int(message.point_stride), message.data
    if not 0 < stride <= _MAX_POINT_STEP or len(data) % stride or len(message.fields) > _MAX_FIELDS:
        raise MalformedData(f"{TYPE}: {len(data)} bytes of data are no points of {stride} bytes")
    limits.check(TYPE, len(data) // stride, stride)
    fields = {one.name: one for one in reversed(message.fields) if one.type in _CODES}
    check_axes(TYPE, fields)
    for name, field in fields.items():
        if field.offset + np.dtype(_CODES[field.type]).itemsize > stride:
            raise MalformedData(f"{TYPE}: the field {name[:40]!r} is outside the {stride} bytes of a point")
    if any(_CODES[fields[axis].type][0] != "f" for axis in "xyz"):
        raise UnsupportedFormat(f"{TYPE}: x, y and z are not FLOAT32 or FLOAT64")
    layout = {
        "names": list(fields),
        "formats": ["<" + _CODES[field.type] for field in fields.values()],
        "offsets": [field.offset for field in fields.values()],
        "itemsize": stride,
    }
    rows = np.frombuffer(data, np.dtype(layout))  # type: ignore[call-overload]
    columns = {name: rows[name] for name in fields}
    stamp = Stamp(int(message.timestamp.seconds), int(message.timestamp.nanos))
    if stamp.sec < 0 or not 0 <= stamp.nanosec < 10**9:
        raise MalformedData(f"{TYPE}: no time since the epoch: {stamp.sec} s and {stamp.nanosec} ns")
    T_frame_cloud = _pose(message)
    if T_frame_cloud is not None:
        with np.errstate(invalid="ignore"):
            placed = transform_points(T_frame_cloud, np.stack([columns[axis] for axis in "xyz"], axis=1))
        columns |= {axis: placed[:, number] for number, axis in enumerate("xyz")}
    return StampedCloud(Header(stamp, message.frame_id), PointCloud(columns))


def _pose(message: Any) -> Matrix | None:
    """Pose of the cloud's origin in its frame; None: in the origin of the frame."""
    if not message.HasField("pose"):
        return None
    place, turn = message.pose.position, message.pose.orientation
    quaternion = (
        [turn.x, turn.y, turn.z, turn.w] if message.pose.HasField("orientation") else [0.0, 0.0, 0.0, 1.0]
    )
    T = from_quaternion([place.x, place.y, place.z], quaternion)
    return None if np.array_equal(T, np.eye(4)) else T
