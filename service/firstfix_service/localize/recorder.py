"""Records of finished queries: metrics, log fields, trace spans and samples."""

from __future__ import annotations

from functools import cache

from firstfix.formats.point_cloud import Body

from ..problems import problem_of
from ..query_workers.answer import EncodedAnswer
from ..query_workers.query import Query
from ..telemetry.metrics import Metrics
from ..telemetry.request_scope import Requests, RequestScope, current_request, note
from ..telemetry.tracing import started_ns
from .recent import RecentAnswers
from .sampler import QuerySampler

_OK = 200


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
