"""Every answer and failure is counted, logged, recorded and shown to those who watch, in one place."""

from __future__ import annotations

import math
import time
from functools import cache, partial
from typing import Any

from firstfix.answer.localization import Reason, Verdict
from firstfix.catalog.recorded_queries import REPLAY
from firstfix.formats.point_cloud import Body

from ..problems import problem_of
from ..query_workers.query import EncodedAnswer, Query
from ..telemetry.metrics import Metrics
from ..telemetry.request_scope import Requests, RequestScope, current_request, note
from ..telemetry.tracing import started_ns
from ..webhooks.event import AnswerEvent
from ..webhooks.sender import WebhookSender
from .answer_counts import AnswerCounts
from .query_recorder import QueryRecorder, is_replay
from .recent_answers import RecentAnswers

_OK = 200
_WORDS = {one: one.value for one in (*Verdict, *Reason)}


class AnswerReporter:
    """Reports the answers of one app. It runs before each answer is sent, so it must be cheap.

    Args:
        recent: keeps the last answers.
        counts: counts the answers of each map.
        recorder: None: no query is recorded.
        webhooks: None: nobody is told of answers.
    """

    def __init__(
        self,
        metrics: Metrics,
        requests: Requests,
        recent: RecentAnswers,
        counts: AnswerCounts,
        recorder: QueryRecorder | None = None,
        webhooks: WebhookSender | None = None,
    ) -> None:
        self._metrics = metrics
        self._requests = requests
        self._recent = recent
        self._counts = counts
        self._recorder = recorder
        self._webhooks = webhooks
        # Finding a series by its labels takes longer than counting in it. There are few series.
        self._verdicts = cache(metrics.verdicts.labels)
        self._probability = cache(metrics.probability.labels)
        self._reasons = cache(metrics.reasons.labels)
        self._stage_seconds = cache(metrics.stage_seconds.labels)
        self._localize_seconds = cache(metrics.localize_seconds.labels)

    def report(self, query: Query, body: Body, answer: EncodedAnswer, queued: float) -> None:
        """Add the stages of an answered query to its trace, and offer it to the recorder and the webhooks.

        Args:
            queued: ``time.monotonic`` when the gate got the query. Its timings begin there.
        """
        scope = current_request()
        if scope is not None and scope.span is not None and self._requests.tracing is not None:
            self._requests.tracing.stages(scope.span, started_ns(queued), answer.timings_ms)
        if scope is not None:
            scope.fields["body_bytes"] = len(body)
        if self._recorder is not None:
            self._recorder.offer(query, body, answer, scope)
        if self._webhooks is not None and scope is not None and not is_replay(query, scope):
            event = AnswerEvent(
                answer,
                f"/replicas/{self._recent.replica}",
                query.caller.name,
                scope.transport,
                scope.seconds,
                scope.request_id,
            )
            self._webhooks.offer(event)

    def count(self, transport: str, outcome: EncodedAnswer | BaseException) -> None:
        """Count one query, answered or failed."""
        scope = current_request()
        seconds = math.nan if scope is None else scope.seconds
        exemplar = None if scope is None or scope.span is None else _exemplar(scope)
        if isinstance(outcome, EncodedAnswer):
            if scope is not None:
                scope.status = _OK
                scope.make_more = partial(
                    _said,
                    outcome.map_id,
                    outcome.map_version,
                    outcome.verdict,
                    outcome.reasons,
                    outcome.probability,
                )
            given = transport, outcome, seconds, exemplar, scope, time.time()
            self._metrics.late.add(self._count_answer, *given)
        else:
            self._count_failure(transport, outcome, scope)
            self._count_seconds(transport, seconds, exemplar)

    def _count_seconds(self, transport: str, seconds: float, exemplar: dict[str, str] | None) -> None:
        if not math.isnan(seconds):  # else nobody knows when it began
            self._localize_seconds(transport).observe(seconds, exemplar)

    def _count_answer(
        self,
        transport: str,
        answer: EncodedAnswer,
        seconds: float,
        exemplar: dict[str, str] | None,
        scope: RequestScope | None,
        time_s: float,
    ) -> None:
        """Count an answer, and tell those who watch and the counts of its map of it."""
        self._count_seconds(transport, seconds, exemplar)
        verdict = _WORDS[answer.verdict]
        self._verdicts(transport, verdict).inc()
        self._probability(verdict).observe(answer.probability)
        for reason in answer.reasons:
            self._reasons(_WORDS[reason]).inc()
        for stage, ms in answer.timings_ms.items():
            self._stage_seconds(stage).observe(ms / 1e3, exemplar)
        if scope is None:
            return
        caller, robot = scope.fields.get("caller", ""), scope.fields.get("robot")
        robot = robot or scope.fields.get("key_name", "")
        self._recent.add(caller, transport, seconds, answer, robot, time_s=time_s)
        if answer.map_id and not scope.request_id.startswith(REPLAY):
            is_localized = answer.verdict is Verdict.LOCALIZED
            self._counts.add(answer.map_id, is_localized, scope.started + seconds)

    def _count_failure(self, transport: str, error: BaseException, scope: RequestScope | None) -> None:
        problem = problem_of(error)
        self._metrics.failures.labels(transport, problem.code).inc()
        note(code=problem.code)
        if scope is None:
            return
        scope.status = problem.status
        if scope.span is not None:
            scope.span.record_exception(error)


def _said(
    map_id: str, map_version: str, verdict: Verdict, reasons: tuple[Reason, ...], probability: float
) -> dict[str, Any]:
    """The fields of an answer in its log line."""
    return {
        "map_id": map_id,
        "map_version": map_version,
        "verdict": _WORDS[verdict],
        "reasons": [_WORDS[reason] for reason in reasons],
        "probability": round(probability, 4),
    }


def _exemplar(scope: RequestScope) -> dict[str, str] | None:
    """The trace id for a metric's exemplar; None where no trace is kept."""
    if scope.trace is None or not scope.trace.sampled:
        return None
    return {"trace_id": scope.trace.trace_id}
