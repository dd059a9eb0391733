"""Encoder of geometry_msgs/PoseArray."""

from __future__ import annotations

from collections.abc import Sequence

from firstfix.ros.cdr import CdrWriter
from firstfix.ros.header import Header, write_header
from firstfix.transform import Matrix, quaternion_of

TYPE = "geometry_msgs/msg/PoseArray"


def encode_pose_array(header: Header, poses: Sequence[Matrix]) -> bytes:
    """Encode (4, 4) poses in the header's frame as little-endian CDR."""
    writer = CdrWriter()
    write_header(writer, header)
    writer.numbers("I", [len(poses)])
    for T in poses:
        writer.numbers("d", [*T[:3, 3], *quaternion_of(T)])
    return writer.bytes()
