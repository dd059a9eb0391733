"""The use case of both transports: a query whose head was read gets its body, and is answered."""

from __future__ import annotations

import time
from collections.abc import Awaitable, Callable, Iterable
from concurrent.futures import Future
from dataclasses import replace

from firstfix.errors import FirstfixError, WorkerLost
from firstfix.formats.point_cloud import Body

from ..maps.map_cache import MapCache
from ..maps.served_maps import Leases
from ..query_workers.query import EncodedAnswer, Query
from ..thread_pools import COPIES
from .query_gate import AskWorker, QueryGate
from .recorder import QueryRecorder


class LocalizeUseCase:
    """Answers queries from the served maps."""

    def __init__(self, maps: MapCache, gate: QueryGate, recorder: QueryRecorder) -> None:
        self._maps = maps
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

        Args:
            body: as it came, with its content encoding.
            check: of the body, once the query has a place.

        Raises:
            InputError: the body cannot be used.
            NotFound: no such map or version.
            VersionError, StoreError: the version cannot be served.
            Overloaded, DeadlineExceeded, WorkerLost: as ``QueryGate.run``.
            CorruptVersion: also if a file of the version was damaged after it was loaded.
        """
        queued = time.monotonic()

        def prepare() -> Future[Leases]:
            return self._maps.lease(query.map_ids, query.options.version)

        async def work(ask: AskWorker, leases: Leases, waited_s: float) -> EncodedAnswer:
            map_s = time.monotonic() - queued - waited_s
            waits_ms = {"queue": waited_s * 1e3, "map": map_s * 1e3}
            try:
                return await ask(replace(query, body=body, versions=leases.served, waits_ms=waits_ms))
            except Exception as error:
                # A file that was damaged under the running service fails in many ways, up to SIGBUS.
                if isinstance(error, WorkerLost) or not isinstance(error, FirstfixError):
                    await COPIES.run(self._maps.check_files, leases.served)
                raise

        answer = await self._gate.run(
            query.asker, prepare, work, size_bytes=len(body), deadline=query.deadline, check=check
        )
        self._recorder.record(query, body, answer, queued)
        return answer

    def count(self, transport: str, outcome: EncodedAnswer | BaseException) -> None:
        """Counts the end of one query in the metrics, the log and the trace."""
        self._recorder.count(transport, outcome)
