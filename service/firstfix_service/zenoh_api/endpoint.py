"""The same use case over zenoh.

    firstfix/{map_id}/localize             one queryable for every map this replica can serve (complete)
    firstfix/{map_id}/localize/{replica}   this replica alone; a liveliness token for each map, where replicas
                                           share the maps for each that is held here
    firstfix/@any/localize                 several maps, named by the parameter ``map=a,b``, or without it all
    firstfix/@any/localize/{replica}       this replica alone; a liveliness token

No map can have the name ``@any``, and no wildcard meets it. The options are selector parameters, the
payload the same bytes as the HTTP body, its encoding the media type. Parameters ``content_encoding``,
``accept``, ``request_id`` and ``traceparent`` stand for HTTP's headers, the attachment for the credential
of its header Authorization, without the word Bearer. Errors are replied as the same problem documents.
"""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Callable, Mapping
from concurrent import futures
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from typing import Any

import structlog
import zenoh

from firstfix.access.permissions import Scope
from firstfix.answer.localization import Localization
from firstfix.errors import FirstfixError, InvalidOption, Overloaded, TooLarge

from .. import problems
from ..auth.authenticate import Access
from ..auth.principal import Caller
from ..localize.pool import QueryPool
from ..localize.response_format import form_of
from ..localize.use_case import LocalizeUseCase
from ..problems import problem_of
from ..settings import Settings
from ..telemetry.request_scope import Requests, note
from .config import session_config
from .log import TRANSPORT, logged_query
from .query import ANY_MAP, ZenohQuery, credential_of, key_of, read_query

_log = structlog.get_logger(__name__)
TRUSTED = "zenoh"  # name of whoever got through zenoh's own access rules
DRAIN_S = 10.0  # for queries under way when the service stops
REPLY_THREADS = 4


class ZenohEndpoint:
    """Opens a session, and from the first ``show_maps`` on answers in it until it is closed."""

    def __init__(
        self,
        settings: Settings,
        replica: str,
        use_case: LocalizeUseCase,
        pool: QueryPool,
        access: Access,
        loop: asyncio.AbstractEventLoop,
        requests: Requests,
    ) -> None:
        """Blocks until the session is open.

        Raises:
            InvalidOption: the config cannot be used, or an endpoint cannot be had.
        """
        self.replica = replica
        self._use_case = use_case
        self._pool = pool
        self._access = access
        self._trusted = settings.zenoh_trusted
        self._loop = loop
        self._requests = requests
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

    def show_maps(self, offered: Mapping[str, bool]) -> None:
        """Keeps one liveliness token a map that is offered here, and one for any. Thread-safe.

        Args:
            offered: of maps that may have changed since the last call.
        """
        with self._tokens_lock:
            if self._closed:
                return
            if not self._queryables:
                for key in (key_of("*"), key_of(ANY_MAP)):
                    for form in (key, f"{key}/{self.replica}"):
                        queryable = self.session.declare_queryable(form, self._on_query, complete=True)
                        self._queryables.append(queryable)
            for map_id, is_offered in {ANY_MAP: True, **offered}.items():
                key = key_of(map_id)
                if is_offered and key not in self._tokens:
                    self._tokens[key] = self.session.liveliness().declare_token(f"{key}/{self.replica}")
                elif not is_offered and key in self._tokens:
                    self._tokens.pop(key).undeclare()

    @property
    def connections(self) -> int:
        """Routers, peers and clients that this session is connected with."""
        return 0 if self._closed else len(self.session.info.transports())

    @property
    def maps_shown(self) -> int:
        """Maps with a liveliness token."""
        return max(len(self._tokens) - 1, 0)  # one is for any map

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
            with query, logged_query(self._requests, query, arrived):
                self._use_case.count(TRANSPORT, error)
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
        with logged_query(self._requests, query, arrived):
            try:
                asked = read_query(query)
                caller = await self._caller(query)
                note(caller=caller.name)
                answer, (content, form) = await self._localize(query, asked, caller, arrived)
            except Exception as error:
                if not isinstance(error, FirstfixError):
                    _log.exception("unexpected error", key=str(query.key_expr))
                self._use_case.count(TRANSPORT, error)
                await self._reply(query, partial(_reply_error, query, error))
                # its frames hold the body, in a ring that only the collector would find, some time
                error.__traceback__ = None
                return
            self._use_case.count(TRANSPORT, answer)
            # The key has to be one that the query's own covers: it may ask for every replica.
            own = f"{asked.key}/{self.replica}"
            key = own if query.key_expr.intersects(zenoh.KeyExpr(own)) else asked.key
            await self._reply(query, partial(query.reply, key, content, encoding=form))

    async def _reply(self, query: Any, send: Callable[[], None]) -> None:
        def reply() -> None:
            with query:
                send()

        await self._loop.run_in_executor(self._replies, reply)

    async def _caller(self, query: Any) -> Caller:
        """
        Raises:
            Unauthorized, Forbidden, RateLimited: as ``Access`` says. Which maps are the caller's the use
                case checks.
        """
        if self._trusted:
            return Caller(TRUSTED)
        caller = await self._access.check(credential_of(query), Scope.LOCALIZE, None)
        self._access.take("localize", caller)
        return caller

    async def _localize(
        self, query: Any, asked: ZenohQuery, caller: Caller, arrived: float
    ) -> tuple[Localization, tuple[bytes, str]]:
        """The answer, and the form in which it was asked for."""
        payload = query.payload  # None: an empty body, as over HTTP
        body = b"" if payload is None else payload.to_bytes()
        answer = await self._use_case.localize(
            body,
            asked.media_type,
            asked.content_encoding,
            asked.map_id,
            asked.options,
            arrived=arrived,
            caller=caller,
        )
        return answer, form_of(answer, asked.pose, body, asked.media_type, asked.content_encoding)


def _reply_error(query: Any, error: BaseException) -> None:
    query.reply_err(problem_of(error).body, encoding=problems.MEDIA_TYPE)
