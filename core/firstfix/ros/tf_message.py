"""tf2_msgs/TFMessage: transforms between frames, of /tf and /tf_static."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from ..transform import Matrix, from_quaternion, quaternion_of
from .cdr import CdrWriter, MessageReader
from .header import Header, Stamp, read_header, write_header

TYPE = "tf2_msgs/msg/TFMessage"
_MAX_TRANSFORMS = 1000


@dataclass(frozen=True)
class StampedTransform:
    """One transform of a message. Frames have no leading slash.

    Attributes:
        numbers: translation x, y, z in metres, quaternion x, y, z, w of any length but zero.
    """

    parent: str
    child: str
    stamp: Stamp
    numbers: tuple[float, ...]

    @property
    def T_parent_child(self) -> Matrix:
        """The transform (4, 4)."""
        return from_quaternion(self.numbers[:3], self.numbers[3:])


def decode_tf(body: bytes | memoryview, *, ros1: bool = False) -> list[StampedTransform]:
    """Decode a TFMessage.

    Raises:
        MalformedData: not a TFMessage, a number that is not finite, or a quaternion of length 0.
        UnsupportedFormat: not plain CDR.
    """
    reader = MessageReader("TFMessage", body, ros1=ros1)
    found = []
    for _ in range(reader.count(_MAX_TRANSFORMS, "transforms")):
        header, child = read_header(reader), reader.text()
        numbers = reader.floats(7)
        if not all(map(math.isfinite, numbers)):
            reader.fail("a transform is not finite")
        if not 1e-9 <= math.hypot(*numbers[3:]) < math.inf:
            reader.fail("the quaternion has no direction")
        found.append(StampedTransform(plain(header.frame_id), plain(child), header.stamp, numbers))
    reader.end()
    return found


def encode_tf(transforms: Sequence[tuple[Header, str, Matrix]]) -> bytes:
    """Encode transforms as little-endian CDR.

    Args:
        transforms: stamp and parent frame, child frame, ``T_parent_child``.
    """
    writer = CdrWriter()
    writer.numbers("I", [len(transforms)])
    for header, child, T_parent_child in transforms:
        write_header(writer, header)
        writer.text(child)
        writer.numbers("d", [*T_parent_child[:3, 3], *quaternion_of(T_parent_child)])
    return writer.bytes()


def plain(frame: str) -> str:
    """The name of a frame without the leading slash that ROS 1 had before tf2."""
    return frame.removeprefix("/")
