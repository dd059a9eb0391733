"""The one use case of both transports: a body and its options in, an answer out."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import Future
from dataclasses import replace

from firstfix.access.permissions import Scope
from firstfix.answer.localization import Localization
from firstfix.answer.options import LocalizeOptions
from firstfix.decode import MEDIA_TYPES
from firstfix.errors import InvalidOption, NotFound, UnsupportedFormat
from firstfix.ids import check_map_id

from ..auth.principal import NOBODY_ASKED, Caller
from ..maps.leases import Leases
from ..maps.map_cache import MapCache
from ..query_workers.base import Workers
from ..query_workers.query import Query
from ..telemetry.request_scope import in_this_context
from .pool import QueryPool
from .recorder import QueryRecorder, RawQuery

MAX_MAPS = 16  # that one query is compared with


class LocalizeUseCase:
    """Answers queries over the maps that are served."""

    def __init__(
        self,
        maps: MapCache,
        pool: QueryPool,
        workers: Workers,
        recorder: QueryRecorder,
        *,
        max_decoded_bytes: int,
    ) -> None:
        self._maps = maps
        self._pool = pool
        self._workers = workers
        self._recorder = recorder
        self._max_decoded_bytes = max_decoded_bytes

    async def localize(
        self,
        body: bytes,
        media_type: str,
        content_encoding: str | None,
        map_id: str,
        options: Mapping[str, str],
        *,
        arrived: float | None = None,
        caller: Caller = NOBODY_ASKED,
    ) -> Localization:
        """The answer to one query, worked out in the bounded pool.

        Args:
            map_id: one map, several separated by commas, or nothing: all that are served. Where there
                are several, their places compete.
            arrived: ``time.monotonic`` when the query came, from which its deadline counts; default: now.
            caller: whose maps compete when none is named.

        Raises:
            Forbidden: a map is named that is not one of the caller's.
            InputError: the body or an option cannot be used.
            NotFound: no such map or version.
            VersionError, StoreError: the version cannot be served.
            Overloaded, DeadlineExceeded: as ``QueryPool.run``.
            WorkerLost: as ``Workers.answer``.
        """
        start = time.monotonic() if arrived is None else arrived
        wanted = LocalizeOptions.from_strings(options)
        check_maps(map_id, caller)
        check_media_type(media_type)
        deadline = None if wanted.deadline_ms is None else start + wanted.deadline_ms / 1e3
        names = self._named(map_id, caller)
        admitted = time.monotonic()

        def work(leases: Leases, waited_s: float) -> Localization:
            map_s = time.monotonic() - admitted - waited_s
            query = Query(
                body, media_type, content_encoding or "", wanted, leases.served, self._max_decoded_bytes
            )
            answer = self._workers.answer(query)
            waits_ms = {"queue": waited_s * 1e3, "map": map_s * 1e3}
            return replace(answer, timings_ms={**waits_ms, **answer.timings_ms})

        def prepare() -> Future[Leases]:
            return self._maps.lease(names, wanted.version)

        answer = await self._pool.run(group_of(names), prepare, in_this_context(work), deadline)
        self._recorder.record(RawQuery(body, media_type, content_encoding, map_id, options), answer, admitted)
        return answer

    def check_room(self, map_id: str, caller: Caller) -> None:
        """For a caller that has not read the body yet.

        Args:
            map_id: as for ``localize``.

        Raises:
            NotFound, InvalidOption: the maps cannot be had.
            Overloaded: there would be no place for the query now.
        """
        self._pool.check_room(group_of(self._named(map_id, caller)))

    def _named(self, map_id: str, caller: Caller) -> list[str]:
        if map_id:
            names = list(dict.fromkeys(map_id.split(",")))
        else:
            names = [name for name in self._maps.served.ids if caller.sees(name)]
        if not names:
            raise NotFound("no map is served yet")
        if len(names) > MAX_MAPS:
            raise InvalidOption(f"a scan is compared with up to {MAX_MAPS} maps, not {len(names)}: name some")
        return names

    def count(self, transport: str, outcome: Localization | BaseException) -> None:
        """Tells of one query's end: the metrics, the log and the trace."""
        self._recorder.count(transport, outcome)


def check_maps(map_id: str, caller: Caller) -> None:
    """
    Raises:
        Forbidden: a map is named that is not one of the caller's. Known before the body is read.
    """
    caller.check(Scope.LOCALIZE)
    for name in map_id.split(",") if map_id else ():
        caller.check(Scope.LOCALIZE, check_map_id(name))


def group_of(map_ids: Sequence[str]) -> str:
    """Whose turn a query takes in the pool: its map's, or that of all queries over several maps."""
    return map_ids[0] if len(map_ids) == 1 else "*"


def check_media_type(media_type: str) -> None:
    """
    Raises:
        UnsupportedFormat: no decoder for it. Known before the body is read.
    """
    name = media_type.split(";", 1)[0].strip().lower()
    if name not in MEDIA_TYPES:
        raise UnsupportedFormat(
            f"no scan has the media type {name[:80]!r}; there are {', '.join(MEDIA_TYPES)}"
        )


def to_json(answer: Localization) -> bytes:
    """The answer's form on both transports."""
    return json.dumps(answer.to_mapping(), separators=(",", ":"), allow_nan=False).encode()
