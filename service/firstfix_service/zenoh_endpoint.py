"""The same use case over zenoh.

    firstfix/{map_id}/localize             one queryable for every map this replica can serve (complete)
    firstfix/{map_id}/localize/{replica}   this replica alone; a liveliness token for each map
    firstfix/@any/localize                 several maps, named by the parameter ``map=a,b``, or without it all
    firstfix/@any/localize/{replica}       this replica alone; a liveliness token

No map can have the name ``@any``, and no wildcard meets it. The options are selector parameters, the
payload the same bytes as the HTTP body, its encoding the media type. A parameter ``content_encoding``
stands for HTTP's header. Errors are replied as the same problem documents.
"""

from __future__ import annotations

import asyncio
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterable
from concurrent import futures
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import Any

import structlog
import zenoh

from firstfix.errors import FirstfixError, InvalidOption, Overloaded, TooLarge
from firstfix.ids import check_map_id
from firstfix.localization import Localization

from . import problems
from .localize import LocalizeUseCase, to_json
from .pool import QueryPool
from .problems import problem_of
from .settings import Settings
from .zenoh_config import session_config

_log = structlog.get_logger(__name__)
CONTENT_ENCODING = "content_encoding"
TRANSPORT = "zenoh"
MAP_PARAMETER = "map"
ANY_MAP = "@any"
DRAIN_S = 10.0  # for queries under way when the service stops
REPLY_THREADS = 4


@dataclass(frozen=True)
class _Asked:
    """A query as it came.

    Attributes:
        key: what the replicas share.
        map_id: as the use case takes it: one, several, or empty for all.
    """

    key: str
    map_id: str
    media_type: str
    content_encoding: str | None
    options: dict[str, str]


class ZenohEndpoint:
    """Opens a session, and from the first ``show_maps`` on answers in it until it is closed."""

    def __init__(
        self,
        settings: Settings,
        replica: str,
        use_case: LocalizeUseCase,
        pool: QueryPool,
        loop: asyncio.AbstractEventLoop,
    ) -> None:
        """Blocks until the session is open.

        Raises:
            InvalidOption: the config cannot be used, or an endpoint cannot be had.
        """
        self.replica = replica
        self._use_case = use_case
        self._pool = pool
        self._loop = loop
        self._max_body_bytes = settings.max_body_bytes
        self._max_pending = settings.workers + settings.queue_size
        self._max_inflight_bytes = settings.max_inflight_bytes
        self._tokens: dict[str, Any] = {}
        self._tokens_lock = threading.Lock()
        self._closed = False
        self._pending: dict[Future[None], int] = {}  # queries not answered yet, to the bytes they hold
        # A reply waits for an asker who does not take it in: the event loop must not.
        self._replies = ThreadPoolExecutor(REPLY_THREADS, thread_name_prefix="zenoh-reply")
        self._queryables: list[Any] = []
        try:
            self.session = zenoh.open(session_config(settings))
        except zenoh.ZError as error:
            raise InvalidOption(f"zenoh: {error}") from None

    def show_maps(self, map_ids: Iterable[str]) -> None:
        """Keeps one liveliness token a map, and one for any. Thread-safe."""
        wanted = {_key_of(map_id) for map_id in (ANY_MAP, *map_ids)}
        with self._tokens_lock:
            if self._closed:
                return
            if not self._queryables:
                for key in (_key_of("*"), _key_of(ANY_MAP)):
                    for form in (key, f"{key}/{self.replica}"):
                        queryable = self.session.declare_queryable(form, self._on_query, complete=True)
                        self._queryables.append(queryable)
            for key in wanted - self._tokens.keys():
                self._tokens[key] = self.session.liveliness().declare_token(f"{key}/{self.replica}")
            for key in self._tokens.keys() - wanted:
                self._tokens.pop(key).undeclare()

    def close(self) -> None:
        """Takes the tokens and keys back first, so that nobody new comes; answers who is there; closes.
        Who comes all the same is told so."""
        with self._tokens_lock:
            self._closed = True
            for token in self._tokens.values():
                token.undeclare()
            self._tokens.clear()
            for queryable in self._queryables:
                queryable.undeclare()
        futures.wait(list(self._pending), timeout=DRAIN_S)
        self.session.close()
        self._replies.shutdown(wait=False)

    def _on_query(self, query: Any) -> None:
        """zenoh's callbacks come one after the other: nothing is done here but to hand over."""
        arrived = time.monotonic()
        size = 0 if query.payload is None else len(query.payload)
        try:
            self._check_room(size)
        except FirstfixError as error:  # before its payload is copied
            self._use_case.count(TRANSPORT, error)
            with query:
                _reply_error(query, error)
            return
        try:
            future = asyncio.run_coroutine_threadsafe(self._answer(query, arrived), self._loop)
        except RuntimeError:  # the loop has ended with the service
            query.drop()
            return
        self._pending[future] = size
        future.add_done_callback(self._ended)

    def _check_room(self, size: int) -> None:
        """
        Raises:
            TooLarge: over the limit of one body.
            Overloaded: the service stops; the pool is full; so many queries wait for it already that it
                will be; or their bodies together would take too much.
        """
        if size > self._max_body_bytes:
            raise TooLarge(f"the body has {size} bytes, the limit is {self._max_body_bytes}")
        if self._closed:
            raise Overloaded("the service is stopping")
        self._pool.check_room()
        held = list(self._pending.values())
        if len(held) >= self._max_pending:
            raise Overloaded(f"{self._max_pending} queries wait or run: try again")
        if held and sum(held) + size > self._max_inflight_bytes:
            raise Overloaded("too many bodies arrive at the same time: try again")

    def _ended(self, future: Future[None]) -> None:
        self._pending.pop(future, None)
        if not future.cancelled() and (error := future.exception()) is not None:
            # A reply that could not be sent: the session is closing, or the asker has gone.
            _log.warning("no reply could be sent", error=repr(error))

    async def _answer(self, query: Any, arrived: float) -> None:
        try:
            asked = read_query(query)
            answer = await self._localize(query, asked, arrived)
        except Exception as error:
            if not isinstance(error, FirstfixError):
                _log.exception("unexpected error", key=str(query.key_expr))
            self._use_case.count(TRANSPORT, error)
            await self._reply(query, partial(_reply_error, query, error))
            return
        self._use_case.count(TRANSPORT, answer)
        # The key has to be one that the query's own covers: it may ask for every replica.
        own = f"{asked.key}/{self.replica}"
        key = own if query.key_expr.intersects(zenoh.KeyExpr(own)) else asked.key
        await self._reply(query, partial(query.reply, key, to_json(answer), encoding="application/json"))

    async def _reply(self, query: Any, send: Callable[[], None]) -> None:
        def reply() -> None:
            with query:
                send()

        await self._loop.run_in_executor(self._replies, reply)

    async def _localize(self, query: Any, asked: _Asked, arrived: float) -> Localization:
        payload = query.payload  # None: an empty body, as over HTTP
        return await self._use_case.localize(
            b"" if payload is None else payload.to_bytes(),
            asked.media_type,
            asked.content_encoding,
            asked.map_id,
            asked.options,
            arrived=arrived,
        )


def read_query(query: Any) -> _Asked:
    """
    Raises:
        InvalidOption: its key names no single map, or a parameter stands twice.
    """
    pairs = list(query.parameters)
    twice = sorted(name for name, count in Counter(name for name, _ in pairs).items() if count > 1)
    if twice:
        raise InvalidOption(f"given more than once: {', '.join(twice)}")
    # Names that begin with an underscore are zenoh's own.
    options = {name: value for name, value in pairs if not name.startswith("_")}
    parts = str(query.key_expr).split("/")
    named = parts[1] if len(parts) > 1 else ""
    map_id = options.pop(MAP_PARAMETER, "") if named == ANY_MAP else check_map_id(named)
    content_encoding = options.pop(CONTENT_ENCODING, None)
    media_type = "" if query.encoding is None else str(query.encoding)
    return _Asked(_key_of(named), map_id, media_type, content_encoding, options)


def _key_of(map_id: str) -> str:
    return f"firstfix/{map_id}/localize"


def _reply_error(query: Any, error: BaseException) -> None:
    query.reply_err(problem_of(error).body, encoding=problems.MEDIA_TYPE)
