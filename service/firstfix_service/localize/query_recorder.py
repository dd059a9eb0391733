"""Recorder of queries: those that the settings choose are stored with their bodies.

A bounded queue feeds one thread that writes. No query waits for it or fails because of it. One for which
there is no room is dropped and counted.
"""

from __future__ import annotations

import json
import queue
import random
import threading
import time
from collections import deque
from dataclasses import dataclass
from datetime import datetime, timezone

import structlog

import firstfix
from firstfix.access.permissions import Scope
from firstfix.answer.localization import Verdict
from firstfix.catalog.recorded_queries import REPLAY, RecordedQueries, RecordedQuery, new_query_id, robot_of
from firstfix.errors import FirstfixError
from firstfix.formats.point_cloud import Body

from ..query_workers.query import EncodedAnswer, Query
from ..settings import Settings
from ..telemetry.metrics import Metrics
from ..telemetry.request_scope import RequestScope

_log = structlog.get_logger(__name__)
MAX_WAITING, MAX_WAITING_BYTES = 64, 64 << 20  # held in memory until they are written
PRUNE_PERIOD_S = 600.0
PER_MINUTE = 10  # of this process: enough to see why scans fail, and no load for a store
MAX_BODY_BYTES = 8 << 20  # of a recorded query: the scan of 300,000 points has 4
STOP_WITHIN_S = 5.0  # for what waits, when the service stops
_MINUTE_S = 60.0


@dataclass(frozen=True)
class RecordingPolicy:
    """Rules for recording queries.

    Attributes:
        share: 0..1 of the answers that are not localized.
        share_localized: 0..1 of the localized answers.
        per_minute: queries that this process records.
        max_body_bytes: queries with a larger body are not recorded.
        max_bytes, max_age_s: limits of all recorded queries in the store. The oldest are removed first.
    """

    share: float
    share_localized: float
    per_minute: int
    max_body_bytes: int
    max_bytes: int
    max_age_s: float

    @classmethod
    def of(cls, settings: Settings) -> RecordingPolicy:
        """The policy in the settings."""
        return cls(
            share=settings.recorded_share,
            share_localized=settings.recorded_share_localized,
            per_minute=PER_MINUTE,
            max_body_bytes=MAX_BODY_BYTES,
            max_bytes=settings.recorded_max_bytes,
            max_age_s=settings.recorded_days * 86400,
        )

    @property
    def is_on(self) -> bool:
        """True if any query can be recorded."""
        return self.share > 0 or self.share_localized > 0

    def share_of(self, answer: EncodedAnswer) -> float:
        """The share of queries with such an answer to record."""
        return self.share_localized if answer.verdict is Verdict.LOCALIZED else self.share


class QueryRecorder:
    """Writes recorded queries in a thread of its own. Thread-safe."""

    def __init__(self, recorded_queries: RecordedQueries, policy: RecordingPolicy, metrics: Metrics) -> None:
        self._recorded_queries = recorded_queries
        self._policy = policy
        self._metrics = metrics
        self._lock = threading.Lock()
        self._taken: deque[float] = deque()  # time.monotonic of the last minute's recorded queries
        self._waiting: queue.Queue[tuple[RecordedQuery, bytes] | None] = queue.Queue()
        self._waiting_bytes = 0
        self._stored_bytes = 0
        self._next_prune = 0.0
        self._thread = threading.Thread(target=self._run, name="query-recorder", daemon=True)

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def close(self) -> None:
        """Stop the thread. Recorded queries that wait are written for up to ``STOP_WITHIN_S``."""
        self._waiting.put(None)
        self._thread.join(STOP_WITHIN_S)

    def offer(self, query: Query, body: Body, answer: EncodedAnswer, scope: RequestScope | None) -> None:
        """Record the query if the policy chooses it. Never blocks and never fails."""
        if random.random() >= self._policy.share_of(answer):
            return
        if is_replay(query, scope):
            return
        result = self._take(len(body))
        if result != "taken":
            self._metrics.recorded_queries.labels(result).inc()
            return
        now = datetime.now(timezone.utc)
        recorded = RecordedQuery(
            query_id=new_query_id(f"{random.getrandbits(32):08x}", now),
            time=now.isoformat(),
            transport="" if scope is None else scope.transport,
            request_id="" if scope is None else scope.request_id,
            trace_id="" if scope is None or scope.trace is None else scope.trace.trace_id,
            map_id=",".join(query.given.map_ids),
            media_type=query.given.media_type,
            content_encoding=query.given.content_encoding,
            options=dict(query.given.options),
            answer=json.loads(answer.json),
            body_bytes=len(body),
            service_version=firstfix.__version__,
            robot=robot_of(query.caller.name),
        )
        self._waiting.put((recorded, bytes(body)))

    def _take(self, size: int) -> str:
        """The word "taken", or the reason against it: a label of the metric."""
        if size > self._policy.max_body_bytes:
            return "too_large"
        with self._lock:
            now = time.monotonic()
            while self._taken and now - self._taken[0] >= _MINUTE_S:
                self._taken.popleft()
            if len(self._taken) >= self._policy.per_minute:
                return "rate_limited"
            if self._waiting.qsize() >= MAX_WAITING or self._waiting_bytes + size > MAX_WAITING_BYTES:
                return "dropped"
            self._taken.append(now)
            self._waiting_bytes += size
        return "taken"

    def _run(self) -> None:
        while True:
            self._prune_if_due()
            try:
                waiting = self._waiting.get(timeout=max(0.1, self._next_prune - time.monotonic()))
            except queue.Empty:
                continue
            if waiting is None:
                return
            self._write(*waiting)

    def _write(self, recorded: RecordedQuery, body: bytes) -> None:
        try:
            self._recorded_queries.put(recorded, body)
            self._stored_bytes += len(body)
            self._metrics.recorded_queries.labels("recorded").inc()
        except FirstfixError as error:
            self._metrics.recorded_queries.labels("failed").inc()
            _log.warning("a recorded query could not be recorded", code=error.code, error=str(error))
        except Exception:  # a defect must not end the thread
            self._metrics.recorded_queries.labels("failed").inc()
            _log.exception("a recorded query could not be recorded")
        finally:
            with self._lock:
                self._waiting_bytes -= len(body)

    def _prune_if_due(self) -> None:
        if time.monotonic() < self._next_prune and self._stored_bytes <= self._policy.max_bytes:
            return
        self._next_prune = time.monotonic() + PRUNE_PERIOD_S
        try:
            self._stored_bytes = self._recorded_queries.prune(
                older_than_s=self._policy.max_age_s, max_bytes=self._policy.max_bytes
            )
        except FirstfixError as error:
            _log.warning("old recorded queries could not be removed", code=error.code, error=str(error))
        except Exception:
            _log.exception("old recorded queries could not be removed")
        self._metrics.recorded_bytes.set(self._stored_bytes)


def is_replay(query: Query, scope: RequestScope | None) -> bool:
    """Whether a recorded query is asked again: by a caller who may read them. It leaves no trace."""
    return (
        scope is not None and scope.request_id.startswith(REPLAY) and query.caller.grant.allows(Scope.BUILD)
    )
