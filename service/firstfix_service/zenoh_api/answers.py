"""Answers of all replicas for those who watch one of them.

    firstfix/@answers/{replica}   published while somebody watches: a list of the replica's last answers

A replica subscribes only while it has watchers, and publishes only while another one subscribes. So this
costs nothing where nobody watches. Messages are notices: those that a network or a receiver cannot take are
lost. Whoever may read the key sees the answers of every caller. So it is used only where zenoh itself keeps
strangers away, or where the service asks nobody for a credential.
"""

from __future__ import annotations

import threading
import time
from typing import Annotated, Any, Literal

import orjson
import structlog
import zenoh
from pydantic import BaseModel, Field, FiniteFloat, TypeAdapter, ValidationError

from firstfix.answer.localization import Reason, Verdict
from firstfix.wire.endpoints import said_by_zenoh

from ..localize.recent_answers import RecentAnswer, RecentAnswers

_log = structlog.get_logger(__name__)
ANSWERS = "firstfix/@answers"
JSON = "application/json"
LOOK_S = 0.25  # between messages
MAX_RECORDS = 50  # in a message: with more answers than these, the newest are published
MAX_BYTES = 128 << 10  # of a message
MAX_MESSAGES_PER_S = 100  # that are read, of all replicas together
RETRY_S = 3.0
_LONGEST_NAME = 200


class _Pose(BaseModel):
    position: tuple[FiniteFloat, FiniteFloat, FiniteFloat]
    quaternion: tuple[FiniteFloat, FiniteFloat, FiniteFloat, FiniteFloat]


class _Answer(BaseModel):
    verdict: Verdict
    reasons: Annotated[list[Reason], Field(max_length=len(Reason))]
    probability: Annotated[float, Field(ge=0, le=1)]
    map_id: Annotated[str, Field(max_length=_LONGEST_NAME)]
    map_version: Annotated[str, Field(max_length=64)]
    T_map_sensor: _Pose | None


class _Record(BaseModel):
    time_s: FiniteFloat
    caller: Annotated[str, Field(max_length=_LONGEST_NAME)]
    robot: Annotated[str, Field(max_length=_LONGEST_NAME)] = ""  # a replica of an earlier release says none
    transport: Literal["http", "zenoh"]
    ms: FiniteFloat
    answer: _Answer


_RECORDS: TypeAdapter[list[_Record]] = TypeAdapter(Annotated[list[_Record], Field(max_length=MAX_RECORDS)])


class ZenohAnswers:
    """Publishes this replica's answers and subscribes to those of others, in a thread of its own.

    Args:
        session: publishes.
        client: config of a second session that subscribes, for replicas that meet at a router: it passes on
            publications to its clients alone. None: ``session`` subscribes.
    """

    def __init__(self, session: Any, recent: RecentAnswers, client: Any | None = None) -> None:
        self._session = session
        self._recent = recent
        self._client = client
        self._publisher = session.declare_publisher(
            f"{ANSWERS}/{recent.replica}",
            encoding=JSON,
            congestion_control=zenoh.CongestionControl.DROP,  # a slow receiver never holds up this replica
        )
        self._last_published = 0
        self._listening: Any = None  # session that subscribes
        self._subscriber: Any = None
        self._next_try = 0.0
        self._second, self._messages = 0, 0
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="zenoh-answers", daemon=True)
        recent.hears_others = True
        self._thread.start()

    def close(self) -> None:
        """Stop to publish and to subscribe."""
        self._stop.set()
        self._thread.join()
        self._unsubscribe()
        self._publisher.undeclare()

    def _run(self) -> None:
        while not self._stop.wait(LOOK_S):
            try:
                self._publish_new()
                self._follow_watchers()
            except zenoh.ZError as error:
                _log.warning("answers of other replicas cannot be watched now", error=said_by_zenoh(error))
                self._next_try = time.monotonic() + RETRY_S
            except Exception:  # a defect must not end the thread
                _log.exception("answers were not passed on")

    def _publish_new(self) -> None:
        found = self._recent.own_after(self._last_published)
        if not found:
            return
        self._last_published = found[-1].number
        if self._publisher.matching_status.matching:
            message = orjson.dumps([_record_of(one) for one in found[-MAX_RECORDS:]])
            if len(message) <= MAX_BYTES:
                self._publisher.put(message)

    def _follow_watchers(self) -> None:
        is_watched = self._recent.watchers > 0
        if is_watched and self._subscriber is None and time.monotonic() >= self._next_try:
            self._listening = self._session if self._client is None else zenoh.open(self._client)
            self._subscriber = self._listening.declare_subscriber(f"{ANSWERS}/*", self._on_message)
        elif not is_watched:
            self._unsubscribe()

    def _unsubscribe(self) -> None:
        subscriber, self._subscriber = self._subscriber, None
        listening, self._listening = self._listening, None
        if subscriber is not None:
            subscriber.undeclare()
        if listening is not None and listening is not self._session:
            listening.close()

    def _on_message(self, sample: Any) -> None:
        replica = str(sample.key_expr).rpartition("/")[2]
        if replica == self._recent.replica or len(sample.payload) > MAX_BYTES or not self._has_room():
            return
        try:
            records = _RECORDS.validate_json(sample.payload.to_bytes())
        except ValidationError:
            _log.warning("a message about answers cannot be read", replica=replica[:_LONGEST_NAME])
            return
        for one in records:
            self._recent.hear(
                replica[:_LONGEST_NAME],
                time_s=one.time_s,
                caller=one.caller,
                robot=one.robot,
                transport=one.transport,
                seconds=one.ms / 1e3,
                map_id=one.answer.map_id,
                json=one.answer.model_dump_json().encode(),
            )

    def _has_room(self) -> bool:
        """Count a message. zenoh calls the subscriber once at a time."""
        second = int(time.monotonic())
        if second != self._second:
            self._second, self._messages = second, 0
        self._messages += 1
        return self._messages <= MAX_MESSAGES_PER_S


def _record_of(one: RecentAnswer) -> dict[str, Any]:
    """The main fields of an answer: what a map and a table show."""
    answer = orjson.loads(one.json)
    return {
        "time_s": one.time_s,
        "caller": one.caller[:_LONGEST_NAME],
        "robot": one.robot,
        "transport": one.transport,
        "ms": one.seconds * 1e3,
        "answer": {name: answer[name] for name in _Answer.model_fields},
    }
