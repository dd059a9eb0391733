"""Names of ROS messages in Content-Type, Accept and zenoh encodings."""

from __future__ import annotations

import math

from ..errors import UnsupportedFormat
from . import point_cloud2, pose_message

CDR = "application/vnd.ros2.cdr"
ZENOH_CDR = "application/cdr"  # zenoh's own name; the schema is the type: application/cdr;pkg/msg/Type
NAMES = (CDR, ZENOH_CDR)
POINT_CLOUD2 = f'{CDR}; type="{point_cloud2.TYPE}"'
POSE = f'{CDR}; type="{pose_message.TYPE}"'


def check_cloud_type(media_type: str) -> None:
    """Checks the message type in a media type. It may be absent.

    Raises:
        UnsupportedFormat: a message other than PointCloud2.
    """
    named = _message_type(media_type.partition(";")[2])
    if named not in (None, point_cloud2.TYPE):
        raise UnsupportedFormat(f"a scan cannot be read from a {named[:80]}, only from a {point_cloud2.TYPE}")


def wants_pose(accept: str) -> bool:
    """Returns whether an Accept header prefers the pose message to JSON. It may be malformed."""
    pose = json = 0.0
    for media_range in accept.split(","):
        name, _, parameters = media_range.partition(";")
        name, weight = name.strip().lower(), _weight(parameters)
        if name in NAMES and _message_type(parameters) in (None, pose_message.TYPE):
            pose = max(pose, weight)
        elif name == "application/json":
            json = max(json, weight)
    return pose > 0 and pose >= json


def _message_type(parameters: str) -> str | None:
    """Returns the value of ``type=pkg/msg/Type``, quoted or not, or zenoh's schema without a name."""
    for parameter in parameters.split(";"):
        key, equals, value = parameter.strip().partition("=")
        if equals and key.strip().lower() == "type":
            return value.strip().strip('"')
        if key and not equals:
            return key
    return None


def _weight(parameters: str) -> float:
    for parameter in parameters.split(";"):
        key, _, value = parameter.partition("=")
        if key.strip().lower() == "q":
            try:
                weight = float(value)
            except ValueError:
                return 0.0
            return weight if math.isfinite(weight) else 0.0
    return 1.0
