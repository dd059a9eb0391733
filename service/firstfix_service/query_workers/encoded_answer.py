"""One query: from its body to the bytes of its answer."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import astuple, replace

import numpy as np
import orjson

from firstfix.answer.localization import Localization
from firstfix.engine.deadline import Deadline
from firstfix.engine.localizer import Localizer, localize_among
from firstfix.engine.map_choice.sought_scan import SoughtScan, describe_sought
from firstfix.engine.stopwatch import Stopwatch
from firstfix.findings.scan_kinds import MAPS_LEFT_OUT
from firstfix.formats.point_cloud import Body
from firstfix.ros.cdr import MessageReader as CdrReader
from firstfix.ros.header import Stamp, read_stamp
from firstfix.ros.pose_message import to_pose_cdr

from .answer_form import PoseFormat
from .query import BodyFormat, EncodedAnswer, Query, ServedVersion

Offer = Callable[[ServedVersion, Localizer, object, Localization], None]


def describe_query(query: Query, max_decoded_bytes: int) -> SoughtScan:
    """The description by which the maps of a query are chosen.

    Raises:
        InputError: the body or an option cannot be used.
    """
    plain = query.body_format.decompress(query.body, max_decoded_bytes)
    return describe_sought(query.body_format.decode(plain), query.options, query.forms)


def answer_query(
    query: Query,
    localizers: Sequence[Localizer],
    max_decoded_bytes: int,
    deadline: Deadline,
    offer: Offer | None = None,
) -> EncodedAnswer:
    """The answer with its map version, the waits, and the time of decoding.

    Args:
        localizers: one for each of ``query.versions``.
        deadline: of the query.
        offer: gets the version that answered, its localizer, the scan and the answer.

    Raises:
        InputError: the body or an option cannot be used.
        QueryCancelled: the deadline was cancelled.
    """
    watch = Stopwatch(deadline)
    with watch.stage("decode"):
        plain = query.body_format.decompress(query.body, max_decoded_bytes)
        scan = query.body_format.decode(plain)
    by_map = {one.map_id: one for one in query.versions}
    if len(localizers) == 1:
        (answered,) = query.versions
        answer = localizers[0].localize(scan, query.options, deadline)
    else:
        maps = dict(zip(by_map, localizers, strict=True))
        answer = localize_among(maps, scan, query.options, deadline, likely_one=query.chosen_of > 0)
        # If no map is sure: the map of the best hypothesis, if there is one.
        answered = by_map[answer.hypotheses[0].map_id] if answer.hypotheses else query.versions[0]
    answer = answer.of_version(answered.map_id, answered.version, provisional=answered.provisional)
    if query.chosen_of > len(localizers):
        left_out = MAPS_LEFT_OUT.found({"searched": len(localizers), "maps": query.chosen_of})
        answer = replace(answer, findings=(*answer.findings, left_out))
    answer = replace(answer, timings_ms={**query.waits_ms, **watch.ms, **answer.timings_ms})
    if offer is not None:
        offer(answered, localizers[query.versions.index(answered)], scan, answer)
    message = _pose_message(answer, query.form.pose, query.body_format, plain)
    return encoded_answer(answer, message, geographic=query.form.geographic)


def _pose_message(
    answer: Localization, pose: PoseFormat | None, body_format: BodyFormat, plain: Body
) -> bytes | None:
    """The ROS message of a pose that was asked for. An answer without a pose has none.

    Its stamp, if none is given, is that of a PointCloud2; of other scans zero: "not known" in ROS.
    """
    if pose is None or answer.T_map_sensor is None:
        return None
    stamp = pose.stamp
    if stamp is None and body_format.decode.is_point_cloud2(plain):
        stamp = read_stamp(CdrReader("PointCloud2", plain))
    return to_pose_cdr(answer, stamp or Stamp(), pose.frame_id)


def encoded_answer(
    answer: Localization, pose_message: bytes | None = None, *, geographic: bool = False
) -> EncodedAnswer:
    """The encoded form of an answer."""
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
        server_timing(answer.timings_ms),
    )


def server_timing(timings_ms: Mapping[str, float]) -> bytes:
    """Milliseconds by stage as a Server-Timing header."""
    return ", ".join([f"{stage};dur={ms:.3f}" for stage, ms in timings_ms.items()]).encode()


def to_json(answer: Localization) -> bytes:
    """The JSON form of an answer, the same on both transports.

    Raises:
        ValueError: a number is not finite.
    """
    if not _is_finite(answer):
        raise ValueError("an answer has a number that is not finite")
    return orjson.dumps(answer.to_mapping(), option=orjson.OPT_SERIALIZE_NUMPY)


def _is_finite(answer: Localization) -> bool:
    """Whether JSON can hold every number: orjson would write null for the others."""
    poses = [answer.T_map_sensor, answer.T_map_base, *(one.T_map_sensor for one in answer.hypotheses)]
    numbers = [answer.probability, *(one.probability for one in answer.hypotheses)]
    for finding in answer.findings:
        numbers += finding.numbers.values()
    if answer.scan is not None:
        numbers += [number for number in astuple(answer.scan) if number is not None]
    if answer.hint is not None:
        poses.append(answer.hint.T_sensor_goal)
        numbers += answer.hint.distance_m, answer.hint.turn_deg, answer.hint.separation
    for one in answer.hypotheses:
        if one.quality is not None:
            numbers += [number for number in astuple(one.quality) if number is not None]
    return (
        all(map(math.isfinite, numbers))
        and bool(np.isfinite([T for T in poses if T is not None]).all())
        and (answer.covariance is None or bool(np.isfinite(answer.covariance).all()))
        and all(
            math.isfinite(one.sigma) and bool(np.isfinite(one.direction).all()) for one in answer.degenerate
        )
        and (answer.twist is None or bool(np.isfinite(answer.twist).all()))
    )
