"""An answer as the worker that found it encodes it. The service passes the bytes on and records the rest."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import astuple, dataclass, field

import numpy as np
import orjson
from numpy.typing import NDArray

from firstfix.answer.localization import Localization, Reason, Verdict
from firstfix.ros.header import Stamp


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
