"""The use case of both transports: a query whose head was read is answered, and the answer is recorded."""

from __future__ import annotations

import asyncio
import itertools
import math
import threading
import time
from collections import deque
from collections.abc import Awaitable, Callable, Iterable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial

import orjson

from firstfix.answer.localization import Verdict
from firstfix.catalog.query_samples import REPLAY
from firstfix.engine.map_choice.sought_scan import SoughtScan
from firstfix.errors import FirstfixError, NotFound, WorkerLost
from firstfix.formats.point_cloud import Body

from ..maps.coarse_maps import CoarseMaps
from ..maps.map_cache import MapCache
from ..maps.served_maps import Leases
from ..problems import problem_of
from ..query_workers.query import EncodedAnswer, Query
from ..telemetry.metrics import Metrics
from ..telemetry.request_scope import Requests, RequestScope, current_request, note
from ..telemetry.tracing import started_ns
from ..thread_pools import CHOICES, COPIES
from ..webhooks.event import AnswerEvent
from ..webhooks.sender import WebhookSender
from .answer_counts import AnswerCounts
from .query_gate import AskWorker, QueryGate
from .sampler import QuerySampler, is_replay

_OK = 200
MOST_ANSWERS = 500
LOADS_SHARE = 0.5  # of the time until the deadline, for loads of chosen maps


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

    @cached_property
    def event(self) -> bytes:
        """The answer as a server-sent event: made once for all who watch, and only if somebody does."""
        head = orjson.dumps(
            {
                "number": self.number,
                "replica": self.replica,
                "time_s": self.time_s,
                "caller": self.caller,
                "transport": self.transport,
                "ms": self.seconds * 1e3,
            }
        )
        return b'event: answer\nid: %d\ndata: %s,"answer":%s}\n\n' % (self.number, head[:-1], self.json)


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
        counts: counts the answers of each map.
        sampler: None: no query is stored.
        webhooks: None: nobody is told of answers.
    """

    def __init__(
        self,
        metrics: Metrics,
        requests: Requests,
        recent: RecentAnswers,
        counts: AnswerCounts,
        sampler: QuerySampler | None = None,
        webhooks: WebhookSender | None = None,
    ) -> None:
        self._metrics = metrics
        self._requests = requests
        self._recent = recent
        self._counts = counts
        self._sampler = sampler
        self._webhooks = webhooks
        # Finding a series by its labels takes longer than counting in it. There are few series.
        self._verdicts = cache(metrics.verdicts.labels)
        self._probability = cache(metrics.probability.labels)
        self._reasons = cache(metrics.reasons.labels)
        self._stage_seconds = cache(metrics.stage_seconds.labels)
        self._localize_seconds = cache(metrics.localize_seconds.labels)

    def record(self, query: Query, body: Body, answer: EncodedAnswer, queued: float) -> None:
        """Adds the stages of an answered query to its trace, and offers it to the sampler and the webhooks.

        Args:
            queued: ``time.monotonic`` when the gate got the query. Its timings begin there.
        """
        scope = current_request()
        if scope is not None and scope.span is not None and self._requests.tracing is not None:
            self._requests.tracing.stages(scope.span, started_ns(queued), answer.timings_ms)
        note(body_bytes=len(body))
        if self._sampler is not None:
            self._sampler.offer(query, body, answer, scope)
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
            if answer.map_id and not scope.request_id.startswith(REPLAY):
                self._counts.add(answer.map_id, answer.verdict is Verdict.LOCALIZED, time.time())
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


class LocalizeUseCase:
    """Answers queries from the served maps."""

    def __init__(self, maps: MapCache, coarse: CoarseMaps, gate: QueryGate, recorder: QueryRecorder) -> None:
        self._maps = maps
        self._coarse = coarse
        self._gate = gate
        self._recorder = recorder

    def served(self) -> Iterable[str]:
        """Returns the maps that are searched if a query names none."""
        return self._maps.served.ids

    def check_room(self, query: Query) -> None:
        """Checks that there is room for the query, before its body is read.

        Raises:
            Overloaded: as ``QueryGate.check_room``.
        """
        self._gate.check_room(query.asker)

    async def localize(
        self, query: Query, body: Body, check: Callable[[], Awaitable[None]] | None = None
    ) -> EncodedAnswer:
        """Returns the answer to a query. Where there are several maps, their places compete.

        Of a query without maps, a worker first describes the scan, and the maps that resemble it are chosen.

        Args:
            body: as it came, with its content encoding.
            check: of the body, once the query has a place.

        Raises:
            InputError: the body cannot be used.
            NotFound: no such map or version.
            VersionError, StoreError: the version cannot be served.
            Overloaded, DeadlineExceeded, WorkerLost: as ``QueryGate.run``.
            CorruptVersion: also if a file of the version was damaged after it was loaded.
            Overloaded: also while the templates of many maps are still being read.
        """
        queued = time.monotonic()
        if not query.map_ids:
            query, check = await self._with_maps(query, body, check), None
        chosen_s = time.monotonic() - queued

        async def work(ask: AskWorker, leases: Leases, waited_s: float) -> EncodedAnswer:
            map_s = time.monotonic() - queued - chosen_s - waited_s
            waits_ms = {"queue": waited_s * 1e3, "map": map_s * 1e3}
            if query.chosen_of:
                waits_ms = {"choose": chosen_s * 1e3, **waits_ms}
            try:
                answer = await ask(replace(query, body=body, versions=leases.served, waits_ms=waits_ms))
                assert isinstance(answer, EncodedAnswer)
                return answer
            except Exception as error:
                # A file that was damaged under the running service fails in many ways, up to SIGBUS.
                if isinstance(error, WorkerLost) or not isinstance(error, FirstfixError):
                    await COPIES.run(self._maps.check_files, leases.served)
                raise

        prepare = partial(self._lease, query)
        answer = await self._gate.run(
            query.asker, prepare, work, size_bytes=len(body), deadline=query.deadline, check=check
        )
        self._recorder.record(query, body, answer, queued)
        return answer

    async def _with_maps(
        self, query: Query, body: Body, check: Callable[[], Awaitable[None]] | None
    ) -> Query:
        """Returns the query with the maps that resemble its scan most, of those that its caller sees."""
        forms = self._coarse.forms

        async def work(ask: AskWorker, nothing: Leases, waited_s: float) -> SoughtScan:
            if not forms:
                return SoughtScan({})
            sought = await ask(replace(query, body=body, forms=forms))
            assert isinstance(sought, SoughtScan)
            return sought

        def prepare() -> Future[Leases]:
            ready: Future[Leases] = Future()
            ready.set_result(Leases([]))
            return ready

        sought = await self._gate.run(
            query.asker, prepare, work, size_bytes=len(body), deadline=query.deadline, check=check
        )
        visible = list(filter(query.caller.sees, self._maps.served.ids))
        if not visible:
            raise NotFound("no map is served any more")
        # A scan that resembles none has too few points, or a descriptor of its own: any map tells it.
        chosen = await CHOICES.run(self._coarse.choose, sought, visible) or tuple(visible[:1])
        return replace(query, map_ids=chosen, chosen_of=len(visible))

    def _lease(self, query: Query) -> Future[Leases]:
        """The versions of the query's maps. Of chosen maps, those that come in time are enough."""
        if not query.chosen_of:
            return self._maps.served.lease(query.map_ids, query.options.version)
        some = self._maps.served.lease_some(query.map_ids)
        if query.deadline != math.inf and not some.future.done():
            left_s = max(0.0, query.deadline - time.monotonic())
            asyncio.get_running_loop().call_later(LOADS_SHARE * left_s, some.settle)
        return some.future

    def count(self, transport: str, outcome: EncodedAnswer | BaseException) -> None:
        """Counts the end of one query in the metrics, the log and the trace."""
        self._recorder.count(transport, outcome)


def _newer(kept: deque[RecentAnswer], number: int) -> list[RecentAnswer]:
    return list(itertools.takewhile(lambda one: one.number > number, reversed(kept)))[::-1]
