"""The form of an answer: JSON, or a ROS pose message for those who ask for it and are localized."""

from __future__ import annotations

from dataclasses import dataclass

from firstfix.answer.localization import Localization
from firstfix.errors import InvalidOption
from firstfix.ros.cdr import MessageReader
from firstfix.ros.header import Stamp, check_frame, read_stamp
from firstfix.ros.media_types import NAMES, POSE, wants_pose
from firstfix.ros.pose_message import MAP_FRAME, to_pose_cdr
from firstfix.wire.content_encoding import first_bytes

from .use_case import to_json

JSON = "application/json"
_STAMP_END = 12  # of a message that begins with a header: encapsulation, seconds, nanoseconds
PARAMETERS = {
    "frame": f"`frame_id` of a pose message, default `{MAP_FRAME}`",
    "stamp": "stamp of a pose message, decimal seconds; default: the cloud's own, of a PointCloud2",
}


@dataclass(frozen=True)
class PoseReply:
    """A wish for a PoseWithCovarianceStamped.

    Attributes:
        stamp: None: the query's own.
    """

    frame_id: str
    stamp: Stamp | None

    @classmethod
    def wanted(cls, accept: str, options: dict[str, str]) -> PoseReply | None:
        """
        Args:
            accept: an Accept header's value.
            options: of the query; PARAMETERS are taken out.

        Raises:
            InvalidOption: a parameter's value cannot be used, or it is given without the wish.
        """
        given = {name: options.pop(name) for name in PARAMETERS if name in options}
        if not wants_pose(accept):
            if given:
                raise InvalidOption(f"{', '.join(given)}: only for an answer as {POSE}")
            return None
        stamp = Stamp.parse(given["stamp"]) if "stamp" in given else None
        return cls(check_frame(given.get("frame", MAP_FRAME)), stamp)


def form_of(
    answer: Localization, pose: PoseReply | None, body: bytes, media_type: str, content_encoding: str | None
) -> tuple[bytes, str]:
    """The reply's bytes and media type. An answer without a pose is JSON whatever was wished for.

    Args:
        body, media_type, content_encoding: of the query, which was decoded already.
    """
    if pose is None or answer.T_map_sensor is None:
        return to_json(answer), JSON
    stamp = _stamp_of(body, media_type, content_encoding) if pose.stamp is None else pose.stamp
    return to_pose_cdr(answer, stamp, pose.frame_id), POSE


def _stamp_of(body: bytes, media_type: str, content_encoding: str | None) -> Stamp:
    """Of a PointCloud2, exact to the nanosecond; of other scans zero, ROS's "not known"."""
    if media_type.partition(";")[0].strip().lower() not in NAMES:
        return Stamp()
    head = first_bytes(body, content_encoding or "", _STAMP_END)
    return read_stamp(MessageReader("PointCloud2", head))
