"""The format of an answer: JSON, or a ROS pose message for a caller who accepts it."""

from __future__ import annotations

from firstfix.errors import InvalidOption
from firstfix.ros.header import Stamp, check_frame
from firstfix.ros.media_types import POSE, wants_pose
from firstfix.ros.pose_message import MAP_FRAME

from ..query_workers.answer import EncodedAnswer, PoseFormat

JSON = "application/json"
PARAMETERS = {
    "frame": f"`frame_id` of a pose message, default `{MAP_FRAME}`",
    "stamp": "stamp of a pose message in decimal seconds; default: the stamp of the PointCloud2",
}


def requested_pose(accept: str, options: dict[str, str]) -> PoseFormat | None:
    """Returns the pose format that a query asks for, or None.

    Args:
        accept: value of an Accept header.
        options: of the query; PARAMETERS are taken out of it.

    Raises:
        InvalidOption: a parameter is malformed, or it comes without the media type.
    """
    given = {name: options.pop(name) for name in PARAMETERS if name in options}
    if not wants_pose(accept):
        if given:
            raise InvalidOption(f"{', '.join(given)}: only for an answer as {POSE}")
        return None
    stamp = Stamp.parse(given["stamp"]) if "stamp" in given else None
    return PoseFormat(check_frame(given.get("frame", MAP_FRAME)), stamp)


def content_of(answer: EncodedAnswer) -> tuple[bytes, str]:
    """Returns the bytes and the media type of an answer: JSON, if there is no pose message."""
    return (answer.json, JSON) if answer.pose_message is None else (answer.pose_message, POSE)
