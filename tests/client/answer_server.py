"""A real server on loopback with behaviour that the test sets."""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from itertools import chain, repeat

import pytest
import uvicorn
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

from tests.client.fake_answers import problem_bytes
from tests.waiting import LIMIT_S


class AnswerServer:
    """A server with one route that gives the queued answers and repeats the last one."""

    def __init__(self) -> None:
        self.requests: list[tuple[str, str, dict[str, str], dict[str, str], bytes]] = []
        self.raw_paths: list[bytes] = []
        self.ports: list[int] = []  # the callers', a connection each
        self.answers: list[Response | Callable[[], Response]] = []
        app = Starlette(routes=[Route("/{path:path}", self._answer, methods=["GET", "POST", "DELETE"])])
        self.socket = socket.create_server(("127.0.0.1", 0))
        self.url = f"http://127.0.0.1:{self.socket.getsockname()[1]}"
        self._server = uvicorn.Server(uvicorn.Config(app, log_level="error"))
        self._thread = threading.Thread(target=self._server.run, args=([self.socket],), daemon=True)
        self._thread.start()

    async def _answer(self, request: Request) -> Response:
        body = await request.body()
        self.raw_paths.append(request.scope["raw_path"])
        self.ports.append(request.scope["client"][1])
        query, headers = dict(request.query_params), dict(request.headers)
        self.requests.append((request.method, request.url.path, query, headers, body))
        answer = self.answers.pop(0) if len(self.answers) > 1 else self.answers[0]
        if isinstance(answer, Response):
            return answer
        from anyio import to_thread

        return await to_thread.run_sync(answer)

    def stop(self) -> None:
        self._server.should_exit = True
        self._server.force_exit = True
        self._thread.join(LIMIT_S)


@contextmanager
def raw_server(*handlers: Callable[[socket.socket], object]) -> Iterator[str]:
    """A server that gives each handler a connection, and the last one all that follow; its URL."""
    listener = socket.create_server(("127.0.0.1", 0))

    def handle(connection: socket.socket, handler: Callable[[socket.socket], object]) -> None:
        with connection, suppress(OSError):
            handler(connection)

    def serve() -> None:
        with suppress(OSError):
            for handler in chain(handlers, repeat(handlers[-1])):
                threading.Thread(target=handle, args=(listener.accept()[0], handler), daemon=True).start()

    threading.Thread(target=serve, daemon=True).start()
    yield f"http://127.0.0.1:{listener.getsockname()[1]}"
    with suppress(OSError):
        listener.shutdown(socket.SHUT_RDWR)
    listener.close()


@pytest.fixture
def server() -> Iterator[AnswerServer]:
    running = AnswerServer()
    yield running
    running.stop()


def ok(body: bytes = b"{}", status: int = 200, **headers: str) -> Response:
    return Response(body, status, headers, media_type="application/json")


def problem(code: str, status: int, **headers: str) -> Response:
    return Response(problem_bytes(code), status, headers, media_type="application/problem+json")
