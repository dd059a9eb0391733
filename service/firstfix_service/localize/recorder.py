"""Records of finished queries: metrics, log fields, trace spans, samples, and the last answers."""

from __future__ import annotations

import itertools
import threading
import time
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache

from firstfix.formats.point_cloud import Body

from ..problems import problem_of
from ..query_workers.query import EncodedAnswer, Query
from ..telemetry.metrics import Metrics
from ..telemetry.request_scope import Requests, RequestScope, current_request, note
from ..telemetry.tracing import started_ns
from .sampler import QuerySampler

_OK = 200
MOST_ANSWERS = 500


@dataclass(frozen=True)
class RecentAnswer:
    """One answer.

    Attributes:
        number: of the answer in this process, ascending without gaps, whoever gave it.
        replica: name of the one that gave it.
        time_s: when it was given, since the epoch.
        caller: name of who asked.
        seconds: from the query's arrival to its answer.
        map_id: the map of the answer; empty if there is none.
        json: the answer; of another replica only its main fields.
    """

    number: int
    replica: str
    time_s: float
    caller: str
    transport: str
    seconds: float
    map_id: str
    json: bytes


class RecentAnswers:
    """The last ``MOST_ANSWERS`` answers of this replica, and as many of all others. Thread-safe.

    Others can never displace this replica's own. Nothing here parses JSON.

    Attributes:
        replica: name of this replica.
        hears_others: set where other replicas tell of their answers.
    """

    def __init__(self, replica: str = "") -> None:
        self.replica = replica
        self.hears_others = False
        self._numbers = itertools.count(1)
        self._own: deque[RecentAnswer] = deque(maxlen=MOST_ANSWERS)
        self._heard: deque[RecentAnswer] = deque(maxlen=MOST_ANSWERS)
        self._watchers = 0
        self._lock = threading.Lock()

    def add(self, caller: str, transport: str, seconds: float, answer: EncodedAnswer) -> None:
        """Keeps an answer of this replica, and forgets the oldest if there are too many."""
        now = time.time()
        with self._lock:
            number = next(self._numbers)
            self._own.append(
                RecentAnswer(
                    number, self.replica, now, caller, transport, seconds, answer.map_id, answer.json
                )
            )

    def hear(
        self,
        replica: str,
        *,
        time_s: float,
        caller: str,
        transport: str,
        seconds: float,
        map_id: str,
        json: bytes,
    ) -> None:
        """Keeps an answer of another replica, and forgets the oldest of others if there are too many."""
        with self._lock:
            number = next(self._numbers)
            self._heard.append(
                RecentAnswer(number, replica, time_s, caller, transport, seconds, map_id, json)
            )

    def after(self, number: int) -> list[RecentAnswer]:
        """Returns the kept answers of all replicas with higher numbers, in the order of their numbers."""
        with self._lock:
            found = _newer(self._own, number) + _newer(self._heard, number)
        return sorted(found, key=lambda one: one.number)

    def own_after(self, number: int) -> list[RecentAnswer]:
        """Returns the kept answers of this replica with higher numbers, oldest first."""
        with self._lock:
            return _newer(self._own, number)

    @property
    def watchers(self) -> int:
        """The number of watchers."""
        with self._lock:
            return self._watchers

    @contextmanager
    def watched(self) -> Iterator[None]:
        """Counts a watcher while it lasts: other replicas are heard only for watchers."""
        with self._lock:
            self._watchers += 1
        try:
            yield
        finally:
            with self._lock:
                self._watchers -= 1


class QueryRecorder:
    """Records the queries of one app. It runs before each answer is sent, so it must be cheap.

    Args:
        recent: keeps the last answers.
        sampler: None: no query is stored.
    """

    def __init__(
        self, metrics: Metrics, requests: Requests, recent: RecentAnswers, sampler: QuerySampler | None = None
    ) -> None:
        self._metrics = metrics
        self._requests = requests
        self._recent = recent
        self._sampler = sampler
        # Finding a series by its labels takes longer than counting in it. There are few series.
        self._verdicts = cache(metrics.verdicts.labels)
        self._probability = cache(metrics.probability.labels)
        self._reasons = cache(metrics.reasons.labels)
        self._stage_seconds = cache(metrics.stage_seconds.labels)
        self._localize_seconds = cache(metrics.localize_seconds.labels)

    def record(self, query: Query, body: Body, answer: EncodedAnswer, queued: float) -> None:
        """Adds the stages of an answered query to its trace, and offers the query to the sampler.

        Args:
            queued: ``time.monotonic`` when the gate got the query. Its timings begin there.
        """
        scope = current_request()
        if scope is not None and scope.span is not None and self._requests.tracing is not None:
            self._requests.tracing.stages(scope.span, started_ns(queued), answer.timings_ms)
        note(body_bytes=len(body))
        if self._sampler is not None:
            self._sampler.offer(query, body, answer, scope)

    def count(self, transport: str, outcome: EncodedAnswer | BaseException) -> None:
        """Counts one query, answered or failed."""
        scope = current_request()
        if isinstance(outcome, EncodedAnswer):
            self._count_answer(transport, outcome, scope)
        else:
            self._count_failure(transport, outcome, scope)
        if scope is not None:
            self._localize_seconds(transport).observe(scope.seconds, _exemplar(scope))

    def _count_answer(self, transport: str, answer: EncodedAnswer, scope: RequestScope | None) -> None:
        verdict = answer.verdict.value
        self._verdicts(transport, verdict).inc()
        self._probability(verdict).observe(answer.probability)
        for reason in answer.reasons:
            self._reasons(reason.value).inc()
        exemplar = None if scope is None else _exemplar(scope)
        for stage, ms in answer.timings_ms.items():
            self._stage_seconds(stage).observe(ms / 1e3, exemplar)
        if scope is not None:
            scope.status = _OK
            self._recent.add(scope.fields.get("caller", ""), transport, scope.seconds, answer)
        note(
            map_id=answer.map_id,
            map_version=answer.map_version,
            verdict=verdict,
            reasons=[reason.value for reason in answer.reasons],
            probability=round(answer.probability, 4),
        )

    def _count_failure(self, transport: str, error: BaseException, scope: RequestScope | None) -> None:
        problem = problem_of(error)
        self._metrics.failures.labels(transport, problem.code).inc()
        note(code=problem.code)
        if scope is None:
            return
        scope.status = problem.status
        if scope.span is not None:
            scope.span.record_exception(error)


def _exemplar(scope: RequestScope) -> dict[str, str] | None:
    """The trace id for a metric's exemplar; None where no trace is kept."""
    if scope.span is None or scope.trace is None or not scope.trace.sampled:
        return None
    return {"trace_id": scope.trace.trace_id}


def _newer(kept: deque[RecentAnswer], number: int) -> list[RecentAnswer]:
    return list(itertools.takewhile(lambda one: one.number > number, reversed(kept)))[::-1]
