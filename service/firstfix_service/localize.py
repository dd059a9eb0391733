"""The one use case of both transports: a body and its options in, an answer out."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping
from dataclasses import replace

from firstfix.decode import MEDIA_TYPES, decode_query, undo_content_encoding
from firstfix.errors import InvalidOption, NotFound, UnsupportedFormat
from firstfix.grant import Scope
from firstfix.ids import check_map_id
from firstfix.localization import Localization
from firstfix.localizer import localize_among
from firstfix.options import LocalizeOptions
from firstfix.stopwatch import Stopwatch

from .caller import NOBODY_ASKED, Caller
from .map_cache import MapCache
from .pool import QueryPool
from .query_recorder import QueryRecorder, RawQuery
from .request_scope import in_this_context

MAX_MAPS = 16  # that one query is compared with


class LocalizeUseCase:
    """Answers queries over the maps that are served."""

    def __init__(
        self, maps: MapCache, pool: QueryPool, recorder: QueryRecorder, *, max_decoded_bytes: int
    ) -> None:
        self._maps = maps
        self._pool = pool
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
        """
        start = time.monotonic() if arrived is None else arrived
        wanted = LocalizeOptions.from_strings(options)
        check_maps(map_id, caller)
        check_media_type(media_type)
        deadline = None if wanted.deadline_ms is None else start + wanted.deadline_ms / 1e3
        queued = time.monotonic()

        def work() -> Localization:
            waited_ms = (time.monotonic() - queued) * 1e3
            return self._answer(body, media_type, content_encoding, map_id, caller, wanted, waited_ms)

        answer = await self._pool.run(in_this_context(work), deadline)
        self._recorder.record(RawQuery(body, media_type, content_encoding, map_id, options), answer, queued)
        return answer

    def _answer(
        self,
        body: bytes,
        media_type: str,
        content_encoding: str | None,
        map_id: str,
        caller: Caller,
        options: LocalizeOptions,
        waited_ms: float,
    ) -> Localization:
        watch = Stopwatch()
        watch.ms["queue"] = waited_ms
        with watch.stage("map"):
            served = {name: self._maps.get(name, options.version) for name in self._named(map_id, caller)}
        with watch.stage("decode"):
            plain = undo_content_encoding(body, content_encoding or "", self._max_decoded_bytes)
            scan = decode_query(plain, media_type)
        self._recorder.note_scan(scan)
        if len(served) == 1:
            (answered,) = served.values()
            answer = answered.localizer.localize(scan, options)
        else:
            answer = localize_among({name: one.localizer for name, one in served.items()}, scan, options)
            # where none is sure, the map of the best place, if there is a place at all
            best = answer.hypotheses[0].map_id if answer.hypotheses else next(iter(served))
            answered = served[best]
        return replace(
            answer,
            map_id=answered.map_id,
            map_version=answered.version,
            timings_ms={**watch.ms, **answer.timings_ms},
        )

    def _named(self, map_id: str, caller: Caller) -> list[str]:
        served = (name for name in self._maps.map_ids if caller.sees(name))
        names = list(dict.fromkeys(map_id.split(","))) if map_id else list(served)
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
