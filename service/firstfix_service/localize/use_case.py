"""The use case of both transports: the head of a query is admitted, then its body is answered."""

from __future__ import annotations

import time
from concurrent.futures import Future
from dataclasses import replace

from firstfix.answer.localization import Localization

from ..auth.principal import Principal
from ..maps.leases import Leases
from ..maps.map_cache import MapCache
from ..query_workers.base import QueryWorkers
from ..query_workers.query import Query
from ..telemetry.request_scope import in_this_context
from .admission import Admission, admit
from .pool import QueryPool
from .query_head import QueryHead
from .recorder import QueryRecorder


class LocalizeUseCase:
    """Answers queries from the served maps."""

    def __init__(
        self,
        maps: MapCache,
        pool: QueryPool,
        workers: QueryWorkers,
        recorder: QueryRecorder,
        *,
        max_decoded_bytes: int,
    ) -> None:
        self._maps = maps
        self._pool = pool
        self._workers = workers
        self._recorder = recorder
        self._max_decoded_bytes = max_decoded_bytes

    def admit(self, head: QueryHead, caller: Principal) -> Admission:
        """Checks a query before its body is read.

        Raises:
            FirstfixError: as ``admission.admit``.
        """
        return admit(head, caller, self._maps.served, self._pool)

    async def localize(self, admission: Admission, body: bytes) -> Localization:
        """Returns the answer to an admitted query. Where there are several maps, their places compete.

        Args:
            body: as it came, with its content encoding.

        Raises:
            InputError: the body cannot be used.
            NotFound: no such map or version.
            VersionError, StoreError: the version cannot be served.
            Overloaded, DeadlineExceeded: as ``QueryPool.run``.
            WorkerLost: as ``QueryWorkers.answer``.
        """
        options, queued = admission.options, time.monotonic()

        def prepare() -> Future[Leases]:
            return self._maps.lease(admission.map_ids, options.version)

        def work(leases: Leases, waited_s: float) -> Localization:
            map_s = time.monotonic() - queued - waited_s
            query = Query(body, admission.body_format, options, leases.served, self._max_decoded_bytes)
            answer = self._workers.answer(query)
            waits_ms = {"queue": waited_s * 1e3, "map": map_s * 1e3}
            return replace(answer, timings_ms={**waits_ms, **answer.timings_ms})

        answer = await self._pool.run(admission.group, prepare, in_this_context(work), admission.deadline)
        self._recorder.record(admission.head, body, answer, queued)
        return answer

    def count(self, transport: str, outcome: Localization | BaseException) -> None:
        """Counts the end of one query in the metrics, the log and the trace."""
        self._recorder.count(transport, outcome)
