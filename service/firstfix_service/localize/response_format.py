"""The format of an answer: JSON, or a ROS pose message for a caller who accepts it."""

from __future__ import annotations

import json
from dataclasses import dataclass

from firstfix.answer.localization import Localization
from firstfix.errors import InvalidOption
from firstfix.ros.cdr import MessageReader
from firstfix.ros.header import Stamp, check_frame, read_stamp
from firstfix.ros.media_types import POSE, wants_pose
from firstfix.ros.pose_message import MAP_FRAME, to_pose_cdr
from firstfix.wire.content_encoding import first_bytes

from .admission import Admission

JSON = "application/json"
_STAMP_END = 12  # of a message that begins with a header: encapsulation, seconds, nanoseconds
PARAMETERS = {
    "frame": f"`frame_id` of a pose message, default `{MAP_FRAME}`",
    "stamp": "stamp of a pose message in decimal seconds; default: the stamp of the PointCloud2",
}


@dataclass(frozen=True)
class PoseFormat:
    """Header of a PoseWithCovarianceStamped that the caller asked for.

    Attributes:
        stamp: None: that of the query's body.
    """

    frame_id: str
    stamp: Stamp | None

    @classmethod
    def requested(cls, accept: str, options: dict[str, str]) -> PoseFormat | None:
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
        return cls(check_frame(given.get("frame", MAP_FRAME)), stamp)


def encode_answer(
    answer: Localization, pose: PoseFormat | None, admission: Admission, body: bytes
) -> tuple[bytes, str]:
    """Returns the bytes and the media type of an answer. An answer without a pose is always JSON.

    Args:
        admission, body: of the query, which was decoded already.
    """
    if pose is None or answer.T_map_sensor is None:
        return to_json(answer), JSON
    stamp = _stamp_of(admission, body) if pose.stamp is None else pose.stamp
    return to_pose_cdr(answer, stamp, pose.frame_id), POSE


def to_json(answer: Localization) -> bytes:
    """Returns the JSON form of an answer, the same on both transports."""
    return json.dumps(answer.to_mapping(), separators=(",", ":"), allow_nan=False).encode()


def _stamp_of(admission: Admission, body: bytes) -> Stamp:
    """The stamp of a PointCloud2, exact to the nanosecond; of other scans zero: "not known" in ROS."""
    if not admission.body_format.is_point_cloud2:
        return Stamp()
    head = first_bytes(body, admission.head.content_encoding or "", _STAMP_END)
    return read_stamp(MessageReader("PointCloud2", head))
