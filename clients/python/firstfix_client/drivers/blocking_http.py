"""Tries over HTTP for blocking calls, on connections that another thread can close."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, suppress
from dataclasses import replace
from typing import Any, TypeVar

import httpx

from ..steps.http import HttpSteps
from ..steps.http_sender import outcome_of_error, outcome_of_response
from ..steps.step import Outcome, Steps, Try, too_late
from . import blocking
from .blocking import Asked, race

T = TypeVar("T")
# Events of httpcore when a socket is there: plain, through a proxy, or with TLS.
_CONNECTED = ("connect_tcp.complete", "connect_unix_socket.complete", "start_tls.complete")


class AbortableConnection:
    """At most one connection, for one query at a time.

    httpx cannot cancel a request from another thread. But shutting down the socket ends every wait on it, and
    the service sees that the caller is gone.

    Args:
        http: used by this object only, with a limit of one connection.
    """

    def __init__(self, http: httpx.Client) -> None:
        self._http = http
        self._lock = threading.Lock()
        self._socket: socket.socket | None = None
        self._aborted = False

    def send(self, request: httpx.Request, *, stream: bool = False) -> httpx.Response:
        """Send a request and return the response.

        Raises:
            httpx.TransportError: no answer, or ``abort`` was called.
        """
        request.extensions = {**request.extensions, "trace": self._on_trace}
        return self._http.send(request, stream=stream)

    def abort(self) -> None:
        """End the request under way. The connection cannot be used again."""
        with self._lock:
            self._aborted = True
            if self._socket is not None:
                with suppress(OSError):  # the other side closed it first
                    self._socket.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        """Close the connection."""
        self._http.close()

    def _on_trace(self, event: str, info: Mapping[str, Any]) -> None:
        if not event.endswith(_CONNECTED):
            return
        with self._lock:
            self._socket = info["return_value"].get_extra_info("socket")
            if self._aborted:
                raise httpx.ConnectError("aborted")


class BlockingHttp:
    """Performs tries. Thread-safe.

    Hedged queries need connections that another thread can close. All other requests share a pool.

    Args:
        transport: replaces the network in tests.
    """

    def __init__(self, headers: Mapping[str, str], transport: httpx.BaseTransport | None) -> None:
        self._headers = headers
        self._transport = transport
        self._tls = httpx.create_ssl_context()
        self._http = self._client(transport, httpx.Limits(max_connections=100, max_keepalive_connections=20))
        self._idle: list[AbortableConnection] = []
        self._lock = threading.Lock()
        self._closed = False

    def close(self) -> None:
        """Close the connections."""
        with self._lock:
            self._closed = True
            idle, self._idle = self._idle, []
        for connection in idle:
            connection.close()
        self._http.close()

    def ask(self, step: Try, opened: ExitStack) -> Asked:
        """Perform a try, as a race if it has a rival."""
        begun = time.monotonic()
        if step.rival is None:
            return self._ask(self._http, step, step.target, opened)
        (target, after_s), until = step.rival, begun + step.timeout_s
        first = _Attempt(self, step, step.target, until)
        late = too_late(step.target, step.timeout_s, repeatable=step.repeatable)
        outcome = race(first, _Attempt(self, step, target, until), after_s, late, step.timeout_s)
        return replace(outcome, took_s=time.monotonic() - begun), iter(())

    def ask_by(self, connection: AbortableConnection, step: Try, target: str) -> Outcome:
        """Perform a try on one replica over this connection."""
        with ExitStack() as opened:
            return self._ask(connection, step, target, opened)[0]

    def borrow(self) -> AbortableConnection:
        """A connection for one query."""
        with self._lock:
            if self._idle:
                return self._idle.pop()
        return AbortableConnection(self._client(_kept(self._transport), httpx.Limits(max_connections=1)))

    def give_back(self, connection: AbortableConnection) -> None:
        """Take back a connection that was not aborted."""
        with self._lock:
            if not self._closed:
                self._idle.append(connection)
                return
        connection.close()

    def _client(self, transport: httpx.BaseTransport | None, limits: httpx.Limits) -> httpx.Client:
        return httpx.Client(
            headers=self._headers,
            transport=transport,
            follow_redirects=False,
            verify=self._tls,
            limits=limits,
        )

    def _ask(
        self, http: httpx.Client | AbortableConnection, step: Try, target: str, opened: ExitStack
    ) -> Asked:
        begun = time.monotonic()
        try:
            with ExitStack() as files:
                request = step.make(step.timeout_s).build(self._http, target, step.timeout_s, files)
                response = http.send(request, stream=True)
                opened.callback(response.close)
                streams = step.stream and response.is_success
                body = b"" if streams else _body(response, begun + step.timeout_s)
        except httpx.RequestError as error:
            return outcome_of_error(target, error, step.timeout_s, step.repeatable), iter(())
        outcome = outcome_of_response(
            target,
            response,
            body,
            repeatable=step.repeatable,
            took_s=time.monotonic() - begun,
        )
        return outcome, _lines(response) if streams else iter(())


class _Attempt:
    """One of two attempts in a race, with a common deadline."""

    def __init__(self, http: BlockingHttp, step: Try, target: str, until: float) -> None:
        self._http, self._step, self._target, self._until = http, step, target, until
        self._lock = threading.Lock()
        self._connection: AbortableConnection | None = None
        self._over = False

    def run(self) -> Outcome:
        connection = self._http.borrow()
        with self._lock:
            self._connection = connection
            if self._over:
                connection.abort()
        left_s = max(self._until - time.monotonic(), 0.001)
        outcome = self._http.ask_by(connection, replace(self._step, timeout_s=left_s), self._target)
        with self._lock:
            aborted, self._over = self._over, True
        if aborted:
            connection.close()
        else:
            self._http.give_back(connection)
        return outcome

    def abort(self) -> None:
        with self._lock:
            if not self._over:
                self._over = True
                if self._connection is not None:
                    self._connection.abort()


class _Shared(httpx.BaseTransport):
    """Transport that stays open when a client that uses it is closed."""

    def __init__(self, transport: httpx.BaseTransport) -> None:
        self._transport = transport

    def handle_request(self, request: httpx.Request) -> httpx.Response:
        return self._transport.handle_request(request)


def _kept(transport: httpx.BaseTransport | None) -> httpx.BaseTransport | None:
    return None if transport is None else _Shared(transport)


def _body(response: httpx.Response, until: float) -> bytes:
    """The whole body. The limit is needed: httpx limits each read, not their sum."""
    pieces = []
    for piece in response.iter_bytes():
        pieces.append(piece)
        if time.monotonic() > until:
            raise httpx.ReadTimeout("the answer takes too long")
    return b"".join(pieces)


def _lines(response: httpx.Response) -> Iterator[str]:
    try:
        yield from response.iter_lines()
    except httpx.TransportError:  # it broke: the reader connects again
        return


class BlockingService:
    """A service over HTTP: the ``steps`` of its calls, and what performs them."""

    def __init__(
        self, steps: HttpSteps, headers: Mapping[str, str], transport: httpx.BaseTransport | None
    ) -> None:
        self.steps = steps
        self._http = BlockingHttp(headers, transport)

    def run(self, steps: Steps[T]) -> T:
        """Perform a call and return its result."""
        return blocking.run(steps, self._http.ask)

    def items(self, steps: Steps[None]) -> Iterator[Any]:
        """Perform a call and yield its items."""
        return blocking.iterate(steps, self._http.ask)

    def close(self) -> None:
        """Close the connections."""
        self._http.close()
