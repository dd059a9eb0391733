"""One query, and how it is answered: the same code in a thread and in a worker process."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from firstfix.answer.localization import Localization
from firstfix.answer.options import LocalizeOptions
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer, localize_among
from firstfix.engine.map_search import Stopwatch
from firstfix.ros.cdr import MessageReader
from firstfix.ros.header import Stamp, read_stamp
from firstfix.ros.pose_message import to_pose_cdr

from .answer import AnswerForm, EncodedAnswer, PoseFormat, encoded_answer
from .body_format import Body, BodyFormat


@dataclass(frozen=True)
class ServedVersion:
    """A map version whose files are on this machine and verified.

    Attributes:
        provisional: coarse and untested, until a full version takes its place.
    """

    map_id: str
    version: str
    directory: Path
    provisional: bool = False


@dataclass(frozen=True)
class Query:
    """A query for a worker: everything but the body is parsed already.

    Attributes:
        body: as it came, with its content encoding.
        options: as the caller gave them, with the time left for ``deadline_ms``.
        versions: of different maps; where there are several, their places compete.
        form: how the caller wants the answer.
        waits_ms: milliseconds that the query waited before, by stage. They become part of its timings.
    """

    body: Body
    body_format: BodyFormat
    options: LocalizeOptions
    versions: tuple[ServedVersion, ...]
    max_decoded_bytes: int
    form: AnswerForm = field(default_factory=AnswerForm)
    waits_ms: Mapping[str, float] = field(default_factory=dict)


Offer = Callable[[ServedVersion, Localizer, object, Localization], None]


def load_localizer(directory: Path) -> Localizer:
    """Returns the localizer of a version's folder."""
    return Localizer(MapIndex.load(directory))


def answer_query(query: Query, localizers: Sequence[Localizer], offer: Offer | None = None) -> EncodedAnswer:
    """Returns the answer with its map version, the waits, and the time of decoding.

    Args:
        localizers: one for each of ``query.versions``.
        offer: gets the version that answered, its localizer, the scan and the answer.

    Raises:
        InputError: the body or an option cannot be used.
    """
    deadline, watch = query.options.deadline_from(time.monotonic()), Stopwatch()
    with watch.stage("decode"):
        plain = query.body_format.decompress(query.body, query.max_decoded_bytes)
        scan = query.body_format.decode(plain)
    by_map = {one.map_id: one for one in query.versions}
    if len(localizers) == 1:
        (answered,) = query.versions
        answer = localizers[0].localize(scan, query.options, deadline)
    else:
        among = dict(zip(by_map, localizers, strict=True))
        answer = localize_among(among, scan, query.options, deadline)
        # If no map is sure: the map of the best hypothesis, if there is one.
        answered = by_map[answer.hypotheses[0].map_id] if answer.hypotheses else query.versions[0]
    answer = replace(
        answer,
        map_id=answered.map_id,
        map_version=answered.version,
        map_provisional=answered.provisional,
        timings_ms={**query.waits_ms, **watch.ms, **answer.timings_ms},
    )
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
    if stamp is None and body_format.is_point_cloud2:
        stamp = read_stamp(MessageReader("PointCloud2", plain))
    return to_pose_cdr(answer, stamp or Stamp(), pose.frame_id)
