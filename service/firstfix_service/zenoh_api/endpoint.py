"""Localization over zenoh.

    firstfix/{map_id}/localize             one queryable for every map that this replica can serve (complete)
    firstfix/{map_id}/localize/{replica}   this replica alone; one liveliness token for each map that it
                                           serves, or that it holds where replicas share the maps
    firstfix/@any/localize                 several maps, named by the parameter ``map=a,b``; without it all
    firstfix/@any/localize/{replica}       this replica alone; one liveliness token

No map can have the id ``@any``, and no wildcard matches it. The options are selector parameters. The payload
has the same bytes as the HTTP body; its encoding is the media type. The parameters ``content_encoding``,
``accept``, ``request_id``, ``traceparent`` and ``robot`` replace the HTTP headers. The attachment is a
signature with the caller's API key (``callers``). Errors are the same problem documents.
"""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Callable, Mapping
from concurrent import futures
from concurrent.futures import Future
from contextlib import ExitStack
from functools import partial
from typing import Any

import structlog
import zenoh

from firstfix.errors import FirstfixError, InvalidOption, Overloaded, TooLarge
from firstfix.wire.endpoints import said_by_zenoh

from ..auth.authenticate import Authenticator
from ..limits.byte_budget import ByteBudget, Lease, owners_of_body
from ..limits.limits import Limits
from ..limits.turns import Turns
from ..localize.use_case import LocalizeUseCase
from ..settings import Settings
from ..telemetry.request_scope import Requests, current_caller, note
from ..telemetry.stall_watch import Pulse
from .callers import ZenohCallers
from .config import session_config
from .query import ANY_MAP, TRANSPORT, UNSIGNED, key_of, logged_query, read_query, reply_error, reply_ok
from .refusals import Refusals
from .replies import ReplyThreads
from .threads import SessionWatch

_log = structlog.get_logger(__name__)
DRAIN_S = 10.0  # for queries under way when the service stops
ENDPOINT_CLOSE_WITHIN_S = DRAIN_S + 5.0
_NOT_READ = "too many answers wait for callers who do not read them: try again"


class ZenohEndpoint:
    """Opens a session, and answers queries in it from the first ``show_maps`` until ``close``."""

    def __init__(
        self,
        settings: Settings,
        replica: str,
        use_case: LocalizeUseCase,
        bodies: ByteBudget,
        authenticator: Authenticator,
        turns: Turns,
        loop: asyncio.AbstractEventLoop,
        requests: Requests,
        pulse: Pulse,
    ) -> None:
        """Block until the session is open.

        Args:
            bodies: those in memory, of HTTP too.
            turns: of all who ask, over HTTP too.
            pulse: of the session's watch.

        Raises:
            InvalidOption: the config cannot be used, or an endpoint cannot be opened.
        """
        self.replica = replica
        self._use_case = use_case
        self._bodies = bodies
        self._callers = ZenohCallers(settings, authenticator)
        self._refusals = Refusals(turns)
        self._loop = loop
        self._requests = requests
        self._max_body_bytes = settings.max_body_bytes
        self._max_pending = Limits.pending_factor * (settings.workers + settings.queue_size)
        self._tokens: dict[str, Any] = {}
        self._tokens_lock = threading.Lock()
        self._closed = False
        self._pending: set[Future[None]] = set()  # queries without an answer yet
        self._replying = 0  # of these, changed by the event loop alone
        self.replies = ReplyThreads()
        self._queryables: list[Any] = []
        try:
            self.session = zenoh.open(session_config(settings))
        except zenoh.ZError as error:
            raise InvalidOption(f"zenoh: {said_by_zenoh(error)}") from None
        self._watch = SessionWatch(self.session, pulse)

    def show_maps(self, offered: Mapping[str, bool], before_each: Callable[[], None]) -> None:
        """Updates the liveliness tokens: one for each map that is offered here, and one for ``@any``.

        Thread-safe.

        Args:
            offered: map id to whether it is offered, of maps that may have changed since the last call.
            before_each: called before each call of zenoh.
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
                before_each()
                key = key_of(map_id)
                if is_offered and key not in self._tokens:
                    self._tokens[key] = self.session.liveliness().declare_token(f"{key}/{self.replica}")
                elif not is_offered and key in self._tokens:
                    self._tokens.pop(key).undeclare()

    @property
    def connections(self) -> int:
        """Number of routers, peers and clients connected with this session, as of a second ago."""
        return self._watch.connections

    @property
    def maps_shown(self) -> int:
        """Number of maps with a liveliness token."""
        return max(len(self._tokens) - 1, 0)  # one token is for any map

    def close(self) -> None:
        """Take back the tokens and keys, answers the queries under way, then close the session.

        A query that comes meanwhile gets an error.
        """
        self._closed = True
        self._watch.close()
        with self._tokens_lock:
            for token in self._tokens.values():
                token.undeclare()
            self._tokens.clear()
            for queryable in self._queryables:
                queryable.undeclare()
        futures.wait(list(self._pending), timeout=DRAIN_S)
        self.replies.close()
        self.session.close()

    def _on_query(self, query: Any) -> None:
        """Hand the query to the event loop. zenoh calls this once at a time, so it must be quick."""
        arrived = time.monotonic()
        size = 0 if query.payload is None else len(query.payload)
        body = self._bodies.lease()
        try:
            self._check_room(size)
            body.grow(size)
        except FirstfixError as error:  # before the payload is copied
            with logged_query(self._requests, query, arrived):
                self._use_case.count(TRANSPORT, error)
            caller = self._callers.look(query)
            self.replies.send(query, partial(reply_error, query, error, caller))
            return
        try:
            future = asyncio.run_coroutine_threadsafe(self._answer(query, body, arrived), self._loop)
        except RuntimeError:  # the loop has ended with the service
            body.end()
            self.replies.end(query)
            return
        self._pending.add(future)
        future.add_done_callback(partial(self._ended, query))

    def _check_room(self, size: int) -> None:
        """Check the limits of zenoh queries, before it is known who asks: the gate checks all others.

        Raises:
            TooLarge: over the limit of one body.
            Overloaded: the service stops, or too many zenoh queries wait already.
        """
        if size > self._max_body_bytes:
            raise TooLarge(f"the body has {size} bytes, the limit is {self._max_body_bytes}")
        if self._closed:
            raise Overloaded("the service is stopping")
        if len(self._pending) - self._replying >= self._max_pending:
            raise Overloaded(f"{self._max_pending} queries wait or run: try again")
        if self.replies.is_full:
            raise Overloaded(_NOT_READ)

    def _ended(self, query: Any, future: Future[None]) -> None:
        self._pending.discard(future)
        if future.cancelled():
            # Otherwise the garbage collector would end the query: on the event loop, which may then wait.
            self.replies.end(query)
        if not future.cancelled() and (error := future.exception()) is not None:
            # The session is closing, or the caller has gone.
            _log.warning("no reply could be sent", error=repr(error))

    async def _answer(self, query: Any, held: Lease, arrived: float) -> None:
        with logged_query(self._requests, query, arrived), ExitStack() as stack:
            stack.callback(held.end)
            caller = UNSIGNED
            try:
                caller = await self._callers.identify(query)
                principal = await self._callers.admit(caller, query)
                note(caller=principal.name)
                if self.replies.is_full_for(principal.name):
                    raise Overloaded(_NOT_READ)
                held.name(*owners_of_body(principal.name))
                shared_key, asked = read_query(query, principal, self._use_case.served, arrived)
                self._use_case.check_room(asked)
                body = b"" if query.payload is None else query.payload.to_bytes()
                answer = await self._use_case.localize(asked, body, partial(caller.check_body, body))
            except Exception as error:
                if not isinstance(error, FirstfixError):
                    _log.exception("unexpected error", key=str(query.key_expr))
                self._use_case.count(TRANSPORT, error)
                await self._refuse(query, partial(reply_error, query, error, caller), held)
                # Its frames hold the body in a reference cycle, which only the garbage collector would free.
                error.__traceback__ = None
                return
            self._use_case.count(TRANSPORT, answer)
            # The reply's key must match the query's, which may ask for every replica.
            own = f"{shared_key}/{self.replica}"
            key = own if query.key_expr.intersects(zenoh.KeyExpr(own)) else shared_key
            await self._reply(query, partial(reply_ok, query, caller, key, *answer.content))

    async def _refuse(self, query: Any, send: Callable[[], None], held: Lease) -> None:
        self._replying += 1  # it takes no place while it waits
        try:
            await self._refusals.wait(current_caller(), held)
        finally:
            self._replying -= 1
        await self._reply(query, send)

    async def _reply(self, query: Any, send: Callable[[], None]) -> None:
        self._replying += 1
        try:
            await asyncio.wrap_future(self.replies.send(query, send, current_caller()))
        finally:
            self._replying -= 1
