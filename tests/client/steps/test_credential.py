"""A client sends its API key to its service only."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import pytest

from firstfix.errors import FirstfixError, InvalidOption, RateLimited
from firstfix_client import Client, RetryPolicy
from firstfix_client.steps.http import VARIABLE, credential

KEY = "ffx_0123456789ab_" + "5e" * 32


class Listener:
    """Records the Authorization of every request, and gives the set answers."""

    def __init__(self, status: int = 200, body: bytes = b'{"maps": []}', **headers: str) -> None:
        self.seen: list[str | None] = []
        listener = self
        self.answers = [(status, body, headers)]

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                listener.seen.append(self.headers["Authorization"])
                status, body, headers = listener.answers[min(len(listener.seen), len(listener.answers)) - 1]
                self.send_response(status)
                for name, value in headers.items():
                    self.send_header(name.replace("_", "-"), value)
                self.send_header("Content-Length", str(len(body)))
                self.end_headers()
                self.wfile.write(body)

            def log_message(self, *_: object) -> None: ...

        self.server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.url = f"http://127.0.0.1:{self.server.server_port}"
        threading.Thread(target=self.server.serve_forever, daemon=True).start()

    def stop(self) -> None:
        self.server.shutdown()
        self.server.server_close()


@pytest.fixture
def listener() -> Iterator[Listener]:
    running = Listener()
    yield running
    running.stop()


@pytest.fixture(autouse=True)
def no_key_in_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(VARIABLE, raising=False)


def test_the_key_is_sent_as_a_bearer(listener: Listener):
    with Client(listener.url, api_key=KEY) as client:
        client.maps()
    assert listener.seen == [f"Bearer {KEY}"]


def test_the_environments_key_is_the_default(listener: Listener, monkeypatch: pytest.MonkeyPatch):
    with Client(listener.url) as client:
        client.maps()
    monkeypatch.setenv(VARIABLE, f"{KEY}\n")
    for given in (None, "other", ""):
        with Client(listener.url, api_key=given) as client:
            client.maps()
    assert listener.seen == [None, f"Bearer {KEY}", "Bearer other", None]


@pytest.mark.parametrize("status", [301, 302, 303, 307, 308])
def test_a_redirect_does_not_get_the_key(listener: Listener, status: int):
    thief = Listener()
    listener.answers = [(status, b"", {"Location": f"{thief.url}/maps"})]
    with Client(listener.url, api_key=KEY) as client, pytest.raises(FirstfixError, match=str(status)):
        client.maps()
    assert len(listener.seen) == 1
    assert thief.seen == []
    thief.stop()


@pytest.mark.parametrize("key", ["a\r\nX-Injected: 1", "a b", "caf\u00e9", "a\x00b"])
def test_a_key_that_is_none_is_refused_and_not_repeated(key: str):
    with pytest.raises(InvalidOption) as refused:
        Client("http://127.0.0.1:1", api_key=key)
    assert key not in str(refused.value)
    assert credential(f" {KEY}\n") == KEY


def test_who_comes_too_often_waits_and_asks_again(listener: Listener):
    body = b'{"code": "rate_limited", "detail": "slowly"}'
    listener.answers = [(429, body, {"Retry_After": "0"}), (200, b'{"maps": []}', {})]
    with Client(listener.url, retry=RetryPolicy(attempts=3, first_wait_s=0.01)) as client:
        assert client.maps() == []
    assert len(listener.seen) == 2
    listener.answers = [(429, body, {"Retry_After": "0"})]
    with (
        Client(listener.url, retry=RetryPolicy(attempts=1)) as client,
        pytest.raises(RateLimited, match="slowly"),
    ):
        client.maps()
