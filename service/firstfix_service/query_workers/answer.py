"""The answer to a query: the form that its caller asks for, and the bytes that a worker makes of it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import astuple, dataclass, field
from typing import NamedTuple

import numpy as np
import orjson
from numpy.typing import NDArray

from firstfix.answer.localization import Localization, Reason, Verdict
from firstfix.catalog.geopose import MEDIA_TYPE as GEOPOSE
from firstfix.errors import InvalidOption, NotAcceptable
from firstfix.ros.header import Stamp, check_frame
from firstfix.ros.media_types import POSE, is_pose
from firstfix.ros.pose_message import MAP_FRAME

JSON = "application/json"
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
    def read(cls, accept: str, options: dict[str, str], *, may_be_geographic: bool = False) -> AnswerForm:
        """Returns the form that a query asks for.

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


@dataclass(frozen=True)
class EncodedAnswer:
    """Answer to a query: its bytes, and what the service records.

    Attributes:
        timings_ms: milliseconds by stage.
        json: the whole answer.
        pose_message: the ROS message, if it was asked for and there is a pose.
        T_map_body: (4, 4) pose for a geographic answer: the robot's if the sensor's mounting was given, else
            the sensor's. None if there is no pose or nobody asked.
    """

    verdict: Verdict
    reasons: tuple[Reason, ...]
    probability: float
    map_id: str
    map_version: str
    timings_ms: Mapping[str, float] = field(default_factory=dict)
    json: bytes = b""
    pose_message: bytes | None = None
    T_map_body: NDArray[np.float64] | None = None

    @property
    def content(self) -> tuple[bytes, str]:
        """Bytes and media type: JSON, if there is no pose message."""
        return (self.json, JSON) if self.pose_message is None else (self.pose_message, POSE)


def encoded_answer(
    answer: Localization, pose_message: bytes | None = None, *, geographic: bool = False
) -> EncodedAnswer:
    """Returns the encoded form of an answer."""
    T_map_body = answer.T_map_sensor if answer.T_map_base is None else answer.T_map_base
    return EncodedAnswer(
        answer.verdict,
        answer.reasons,
        answer.probability,
        answer.map_id,
        answer.map_version,
        answer.timings_ms,
        to_json(answer),
        pose_message,
        T_map_body if geographic else None,
    )


def to_json(answer: Localization) -> bytes:
    """Returns the JSON form of an answer, the same on both transports.

    Raises:
        ValueError: a number is not finite.
    """
    if not _is_finite(answer):
        raise ValueError("an answer has a number that is not finite")
    return orjson.dumps(answer.to_mapping(), option=orjson.OPT_SERIALIZE_NUMPY)


def _is_finite(answer: Localization) -> bool:
    """Returns whether JSON can hold every number: orjson would write null for the others."""
    poses = [answer.T_map_sensor, answer.T_map_base, *(one.T_map_sensor for one in answer.hypotheses)]
    numbers = [answer.probability, *(one.probability for one in answer.hypotheses)]
    if answer.hint is not None:
        poses.append(answer.hint.T_sensor_goal)
        numbers += answer.hint.distance_m, answer.hint.turn_deg, answer.hint.separation
    for one in answer.hypotheses:
        if one.quality is not None:
            numbers += astuple(one.quality)
    return (
        all(map(math.isfinite, numbers))
        and bool(np.isfinite([T for T in poses if T is not None]).all())
        and (answer.covariance is None or bool(np.isfinite(answer.covariance).all()))
        and (answer.twist is None or bool(np.isfinite(answer.twist).all()))
    )
