"""The form of an answer, as a caller asks for it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from firstfix.catalog.geopose import MEDIA_TYPE as GEOPOSE
from firstfix.errors import InvalidOption, NotAcceptable
from firstfix.ros.header import Stamp, check_frame
from firstfix.ros.media_types import POSE, is_pose
from firstfix.ros.pose_message import MAP_FRAME

PARAMETERS = {
    "frame": f"`frame_id` of a pose message, default `{MAP_FRAME}`",
    "stamp": "stamp of a pose message in decimal seconds; default: the stamp of the PointCloud2",
}
JSON = "application/json"


@dataclass(frozen=True)
class PoseFormat:
    """Header of a PoseWithCovarianceStamped that the caller asked for.

    Attributes:
        stamp: None: that of the query's body.
    """

    frame_id: str
    stamp: Stamp | None


@dataclass(frozen=True)
class AnswerForm:
    """Forms in which a caller wants a pose. JSON is always made.

    Attributes:
        pose: None: no ROS message.
        geographic: the service needs the pose itself, to place it on the Earth.
    """

    pose: PoseFormat | None = None
    geographic: bool = False

    @classmethod
    def of(cls, accept: str, options: dict[str, str], *, may_be_geographic: bool = False) -> AnswerForm:
        """The form that a query asks for.

        Args:
            accept: value of an Accept header (RFC 9110).
            options: of the query; PARAMETERS are taken out of it.

        Raises:
            InvalidOption: a parameter is malformed, or it comes without the media type.
            NotAcceptable: geographic poses are offered, and the caller accepts no form.
        """
        given = {name: options.pop(name) for name in PARAMETERS if name in options}
        ranges = [_media_range(item) for item in accept.split(",")]
        pose = max((one.weight for one in ranges if is_pose(one.name, one.parameters)), default=0.0)
        if pose > 0 and pose >= max((one.weight for one in ranges if one.name == JSON), default=0.0):
            stamp = Stamp.parse(given["stamp"]) if "stamp" in given else None
            return cls(PoseFormat(check_frame(given.get("frame", MAP_FRAME)), stamp))
        if given:
            raise InvalidOption(f"{', '.join(given)}: only for an answer as {POSE}")
        if not may_be_geographic or not accept.strip():
            return cls()
        json, geopose = _weight_of(ranges, JSON), _weight_of(ranges, GEOPOSE)
        if max(json, geopose) <= 0:
            raise NotAcceptable(f"the answer can be {JSON} or {GEOPOSE}, not {accept[:200]!r}")
        return cls(geographic=geopose > json)


class _MediaRange(NamedTuple):
    name: str
    parameters: str
    weight: float


def _media_range(item: str) -> _MediaRange:
    name, _, parameters = item.partition(";")
    return _MediaRange(name.strip().lower(), parameters, _quality(parameters))


def _quality(parameters: str) -> float:
    for parameter in parameters.split(";"):
        name, _, value = parameter.partition("=")
        if name.strip().lower() == "q":
            try:
                weight = float(value)
            except ValueError:
                return 0.0
            return min(max(weight, 0.0), 1.0) if math.isfinite(weight) else 0.0
    return 1.0


def _weight_of(ranges: Sequence[_MediaRange], media_type: str) -> float:
    """Weight of the most specific range that covers the media type; 0: not accepted."""
    covers = {"*/*": 0, f"{media_type.split('/', 1)[0]}/*": 1, media_type: 2}
    return max(((covers[one.name], one.weight) for one in ranges if one.name in covers), default=(0, 0.0))[1]
