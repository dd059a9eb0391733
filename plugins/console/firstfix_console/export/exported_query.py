"""Recorded queries as viewers show them: the points, the answered pose, and the verdict in words."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from datetime import datetime, timezone

import numpy as np
from numpy.typing import NDArray

from firstfix.answer.localization import Localization
from firstfix.catalog.recorded_queries import MAX_DECODED_BYTES, RecordedQuery
from firstfix.decode import decode_query
from firstfix.errors import InputError, NotFound
from firstfix.transform import Matrix, pose_from_mapping, yaw_of
from firstfix.wire.content_encoding import undo_content_encoding

from .shown_scan import NO_POINTS, ShownScan
from .source import ExportSource

MAP_FRAME = "map"
SENSOR_FRAME = "sensor"  # of a query that is localized
GUESS_FRAME = "best_hypothesis"  # of one that is not, at its first hypothesis
UNPLACED_FRAME = "sensor_unplaced"  # of one without any pose: no transform leads to it
LATEST_S = 86_400.0  # a stamp further from the time of the answer is a recording's, or that of a wrong clock


@dataclass(frozen=True)
class ExportedQuery:
    """One recorded query about a map.

    Attributes:
        time_ns: since the epoch: the scan's stamp, or without one the time of the answer.
        answer: as it was given.
        points: (n, 3) float32 in the frame ``frame``; of several scans all, in the frame of the last.
        frame: ``SENSOR_FRAME``, ``GUESS_FRAME`` or ``UNPLACED_FRAME``.
        T_map_frame: (4, 4) of this frame; None: it has no pose in this map.
        hypotheses: (4, 4) each, best first: those in this map.
        T_map_truth: (4, 4), where the scan was taken, if somebody has told and it was in this map.
        words: the verdict and what belongs to it.
        unreadable: why there are no points; empty: the points were read.
    """

    time_ns: int
    recorded: RecordedQuery
    answer: Localization
    points: NDArray[np.float32]
    frame: str
    T_map_frame: Matrix | None
    hypotheses: tuple[Matrix, ...]
    T_map_truth: Matrix | None
    words: str
    unreadable: str

    @property
    def localized(self) -> bool:
        """Whether the answer has a pose in this map."""
        return self.frame == SENSOR_FRAME


def exported_queries(
    recorded: Iterable[RecordedQuery], map_id: str, scan_of: Callable[[RecordedQuery], ShownScan]
) -> Iterator[ExportedQuery]:
    """Yield recorded queries about a map, with the scan of one in memory."""
    for one in recorded:
        try:
            yield _exported(one, map_id, scan_of(one))
        except (ValueError, KeyError, TypeError) as error:  # a record that an older or newer release wrote
            raise InputError(f"recorded query {one.query_id}: its record cannot be read: {error!r}") from None


def read_scan(source: ExportSource, recorded: RecordedQuery) -> ShownScan:
    """Read and decode the scan of a recorded query, in this process."""
    try:
        body = source.body(recorded.query_id)
        plain = undo_content_encoding(body, recorded.content_encoding, MAX_DECODED_BYTES)
        return ShownScan.of(decode_query(plain, recorded.media_type))
    except (InputError, NotFound) as error:
        return ShownScan(NO_POINTS, unreadable=str(error))


def _exported(recorded: RecordedQuery, map_id: str, scan: ShownScan) -> ExportedQuery:
    answer = Localization.from_mapping(recorded.answer)
    pose = answer.T_map_sensor if answer.map_id in ("", map_id) else None
    hypotheses = tuple(
        h.T_map_sensor for h in answer.hypotheses if (h.map_id or answer.map_id or map_id) == map_id
    )
    placed = pose if pose is not None else next(iter(hypotheses), None)
    frame = UNPLACED_FRAME if placed is None else GUESS_FRAME if pose is None else SENSOR_FRAME
    told = recorded.truth.get("T_map_sensor") if recorded.truth.get("map_id") == map_id else None
    return ExportedQuery(
        _time_ns(recorded, scan.stamp_s),
        recorded,
        answer,
        scan.points,
        frame,
        placed,
        hypotheses,
        None if told is None else pose_from_mapping(told),
        _words(recorded, answer, map_id, pose, scan.unreadable),
        scan.unreadable,
    )


def _time_ns(recorded: RecordedQuery, stamp_s: float | None) -> int:
    answered = datetime.fromisoformat(recorded.time)
    if answered.tzinfo is None:
        answered = answered.replace(tzinfo=timezone.utc)
    answered_s = answered.timestamp()
    if stamp_s is None or not abs(stamp_s - answered_s) < LATEST_S:
        stamp_s = answered_s
    return round(stamp_s * 1e6) * 1000  # a float64 of the epoch holds no nanoseconds


def _words(
    recorded: RecordedQuery, answer: Localization, map_id: str, pose: Matrix | None, unreadable: str
) -> str:
    why = f" ({', '.join(reason.value for reason in answer.reasons)})" if answer.reasons else ""
    parts = [f"{answer.verdict.value}{why}, probability {answer.probability:.3f}"]
    if pose is not None:
        x, y, z = pose[:3, 3]
        parts.append(f"x {x:.2f}, y {y:.2f}, z {z:.2f} m, yaw {np.degrees(yaw_of(pose)):.1f} deg")
    elif answer.T_map_sensor is not None:
        parts.append(f"in map {answer.map_id}, not in {map_id}")
    elif answer.hypotheses:
        parts.append(f"{len(answer.hypotheses)} hypotheses")
    if unreadable:
        parts.append(f"its points cannot be shown: {unreadable}")
    return f"{recorded.query_id}: {'; '.join(parts)}"
