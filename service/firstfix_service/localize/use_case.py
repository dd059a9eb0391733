"""The use case of both transports: a query whose head was read is answered, and the answer is recorded."""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Awaitable, Callable, Iterable
from concurrent.futures import Future
from functools import partial

from firstfix.engine.map_choice.sought_scan import SoughtScan
from firstfix.errors import FirstfixError, NotFound, WorkerLost
from firstfix.formats.point_cloud import Body

from ..maps.coarse_maps import CoarseMaps
from ..maps.map_cache import MapCache
from ..maps.served_maps import Leases
from ..query_workers.look import Asked, Look
from ..query_workers.query import EncodedAnswer, Query
from ..thread_pools import CHOICES, COPIES
from .answer_reporter import AnswerReporter
from .query_gate import QueryGate

LOADS_SHARE = 0.5  # of the time until the deadline, for loads of chosen maps


class LocalizeUseCase:
    """Answers queries from the served maps."""

    def __init__(self, maps: MapCache, coarse: CoarseMaps, gate: QueryGate, reporter: AnswerReporter) -> None:
        self._maps = maps
        self._coarse = coarse
        self._gate = gate
        self._reporter = reporter

    def served(self) -> Iterable[str]:
        """The maps that are searched if a query names none."""
        return self._maps.served.ids

    def check_room(self, asked: Asked) -> None:
        """Check that there is room for the query or the look, before its body is read.

        Raises:
            Overloaded: as ``QueryGate.check_room``.
        """
        self._gate.check_room(asked.asker)

    async def localize(
        self, query: Query, body: Body, check: Callable[[], Awaitable[None]] | None = None
    ) -> EncodedAnswer:
        """The answer to a query. Where there are several maps, their places compete.

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
            sought = SoughtScan({})
            if forms := self._coarse.forms:
                sought, check = await self._described(query, body, forms, check), None
            query = await self._with_maps(query, sought)
        chosen_s = time.monotonic() - queued

        def ask_for(leases: Leases, waited_s: float) -> Query:
            map_s = time.monotonic() - queued - chosen_s - waited_s
            waits_ms = {"queue": waited_s * 1e3, "map": map_s * 1e3}
            if query.chosen_of:
                waits_ms = {"choose": chosen_s * 1e3, **waits_ms}
            return query.filled(body=body, versions=leases.served, waits_ms=waits_ms)

        answer = await self._gate.run(
            query.asker,
            partial(self._lease, query),
            ask_for,
            size_bytes=len(body),
            deadline=query.deadline,
            check=check,
            failed=self._failed,
        )
        assert isinstance(answer, EncodedAnswer)
        self._reporter.report(query, body, answer, queued)
        return answer

    async def look(self, look: Look, body: Body) -> bytes:
        """The answer to a look, which has its place, its turn and its limits as a query has.

        Args:
            body: as it came, with its content encoding.

        Raises:
            InputError: the body cannot be used.
            NotFound: no such map or version.
            VersionError, StoreError: the version cannot be served.
            Overloaded, DeadlineExceeded, WorkerLost: as ``QueryGate.run``.
            CorruptVersion: also if a file of the version was damaged after it was loaded.
        """

        def ask_for(leases: Leases, waited_s: float) -> Look:
            directory = leases.served[0].directory if leases.served else None
            return look.filled(body=body, directory=directory)

        def prepare() -> Future[Leases] | Leases:
            return self._maps.served.lease((look.map_id,), look.version) if look.map_id else Leases([])

        answer = await self._gate.run(look.asker, prepare, ask_for, size_bytes=len(body), failed=self._failed)
        assert isinstance(answer, bytes)
        return answer

    async def _failed(self, leases: Leases, error: Exception) -> None:
        """Check the files of versions over which a worker failed.

        One that was damaged under the running service fails in many ways, up to SIGBUS.
        """
        if isinstance(error, WorkerLost) or not isinstance(error, FirstfixError):
            await COPIES.run(self._maps.check_files, leases.served)

    async def _described(
        self, query: Query, body: Body, forms: tuple[str, ...], check: Callable[[], Awaitable[None]] | None
    ) -> SoughtScan:
        """A worker's description of the scan, by which its maps are chosen."""
        sought = await self._gate.run(
            query.asker,
            lambda: Leases([]),
            lambda nothing, waited_s: query.filled(body=body, forms=forms),
            size_bytes=len(body),
            deadline=query.deadline,
            check=check,
        )
        assert isinstance(sought, SoughtScan)
        return sought

    async def _with_maps(self, query: Query, sought: SoughtScan) -> Query:
        """The query with the maps that resemble its scan most, of those that its caller sees."""
        visible = list(filter(query.caller.sees, self._maps.served.ids))
        if not visible:
            raise NotFound("no map is served any more")
        # A scan that resembles none has too few points, or a descriptor of its own: any map tells it.
        chosen = await CHOICES.run(self._coarse.choose, sought, visible) or tuple(visible[:1])
        return query.filled(map_ids=chosen, chosen_of=len(visible))

    def _lease(self, query: Query) -> Future[Leases] | Leases:
        """The versions of the query's maps. Of chosen maps, those that come in time are enough."""
        if not query.chosen_of:
            served, version = self._maps.served, query.options.version
            loaded = served.lease_loaded(query.map_ids[0], version) if len(query.map_ids) == 1 else None
            return loaded or served.lease(query.map_ids, version)
        some = self._maps.served.lease_some(query.map_ids)
        if query.deadline != math.inf and not some.future.done():
            left_s = max(0.0, query.deadline - time.monotonic())
            asyncio.get_running_loop().call_later(LOADS_SHARE * left_s, some.settle)
        return some.future

    def count(self, transport: str, outcome: EncodedAnswer | BaseException) -> None:
        """Count the end of one query in the metrics, the log and the trace."""
        self._reporter.count(transport, outcome)
