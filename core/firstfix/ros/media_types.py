"""Names of ROS messages in Content-Type, Accept and zenoh encodings."""

from __future__ import annotations

from ..errors import UnsupportedFormat
from . import point_cloud2, pose_message

CDR = "application/vnd.ros2.cdr"
ZENOH_CDR = "application/cdr"  # zenoh's own name; the schema is the type: application/cdr;pkg/msg/Type
NAMES = (CDR, ZENOH_CDR)
POINT_CLOUD2 = f'{CDR}; type="{point_cloud2.TYPE}"'
POSE = f'{CDR}; type="{pose_message.TYPE}"'


def check_cloud_type(media_type: str) -> None:
    """Check the message type in a media type. It may be absent.

    Raises:
        UnsupportedFormat: a message other than PointCloud2.
    """
    named = _message_type(media_type.partition(";")[2])
    if named not in (None, point_cloud2.TYPE):
        raise UnsupportedFormat(f"a scan cannot be read from a {named[:80]}, only from a {point_cloud2.TYPE}")


def is_pose(name: str, parameters: str) -> bool:
    """Whether a media range names the pose message. It may be malformed.

    Args:
        name: in lower case.
        parameters: after the first semicolon.
    """
    return name in NAMES and _message_type(parameters) in (None, pose_message.TYPE)


def _message_type(parameters: str) -> str | None:
    """The value of ``type=pkg/msg/Type``, quoted or not, or zenoh's schema without a name."""
    for parameter in parameters.split(";"):
        key, equals, value = parameter.strip().partition("=")
        if equals and key.strip().lower() == "type":
            return value.strip().strip('"')
        if key and not equals:
            return key
    return None
