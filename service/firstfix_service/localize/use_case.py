"""The use case of both transports: the head of a query is admitted, then its body is answered."""

from __future__ import annotations

import time
from concurrent.futures import Future
from dataclasses import replace

from firstfix.answer.options import LocalizeOptions
from firstfix.errors import FirstfixError, WorkerLost

from ..auth.principal import Principal
from ..maps.leases import Leases
from ..maps.map_cache import MapCache
from ..query_workers.answer import AnswerForm, EncodedAnswer
from ..query_workers.base import QueryWorkers
from ..query_workers.body_format import Body
from ..query_workers.query import Query
from ..thread_pools import COPIES
from .admission import Admission, admit
from .query_gate import QueryPool
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

    async def localize(self, admission: Admission, body: Body, form: AnswerForm) -> EncodedAnswer:
        """Returns the answer to an admitted query. Where there are several maps, their places compete.

        Args:
            body: as it came, with its content encoding.
            form: how the caller wants the answer.

        Raises:
            InputError: the body cannot be used.
            NotFound: no such map or version.
            VersionError, StoreError: the version cannot be served.
            Overloaded, DeadlineExceeded: as ``QueryPool.run``.
            CorruptVersion: also if a file of the version was damaged after it was loaded.
            WorkerLost: as ``QueryWorkers.answer``.
        """
        options, queued = admission.options, time.monotonic()

        def prepare() -> Future[Leases]:
            return self._maps.lease(admission.map_ids, options.version)

        async def work(leases: Leases, waited_s: float) -> EncodedAnswer:
            map_s = time.monotonic() - queued - waited_s
            waits_ms = {"queue": waited_s * 1e3, "map": map_s * 1e3}
            query = Query(
                body,
                admission.body_format,
                _with_time_left(options, admission.deadline),
                leases.served,
                self._max_decoded_bytes,
                form,
                waits_ms,
            )
            try:
                return await self._workers.answer(query)
            except Exception as error:
                # A file that was damaged under the running service fails in many ways, up to SIGBUS.
                if isinstance(error, WorkerLost) or not isinstance(error, FirstfixError):
                    await COPIES.run(self._maps.check_files, leases.served)
                raise

        answer = await self._pool.run(
            admission.asker, prepare, work, size_bytes=len(body), deadline=admission.deadline
        )
        self._recorder.record(admission.head, body, answer, queued)
        return answer

    def count(self, transport: str, outcome: EncodedAnswer | BaseException) -> None:
        """Counts the end of one query in the metrics, the log and the trace."""
        self._recorder.count(transport, outcome)


def _with_time_left(options: LocalizeOptions, deadline: float | None) -> LocalizeOptions:
    """The options with the time that the wait has left: no search begins that would end too late."""
    if deadline is None:
        return options
    return replace(options, deadline_ms=(deadline - time.monotonic()) * 1e3)
