"""A client sends its API key to its service only."""

from __future__ import annotations

import pytest
from starlette.responses import Response

from firstfix.errors import FirstfixError, InvalidOption, RateLimited
from firstfix_client import Client, RetryPolicy
from firstfix_client.steps.http import VARIABLE, credential
from tests.client.answer_server import AnswerServer, ok, problem

MAPS = ok(b'{"maps": []}')


def keys_of(server: AnswerServer) -> list[str | None]:
    """Authorization header of each request."""
    return [headers.get("authorization") for *_, headers, _ in server.requests]


KEY = "ffx_0123456789ab_" + "5e" * 32


@pytest.fixture(autouse=True)
def no_key_in_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(VARIABLE, raising=False)


def test_the_key_is_sent_as_a_bearer(server: AnswerServer):
    server.answers = [MAPS]
    with Client(server.url, api_key=KEY) as client:
        client.maps()
    assert keys_of(server) == [f"Bearer {KEY}"]


def test_the_environments_key_is_the_default(server: AnswerServer, monkeypatch: pytest.MonkeyPatch):
    server.answers = [MAPS]
    with Client(server.url) as client:
        client.maps()
    monkeypatch.setenv(VARIABLE, f"{KEY}\n")
    for given in (None, "other", ""):
        with Client(server.url, api_key=given) as client:
            client.maps()
    assert keys_of(server) == [None, f"Bearer {KEY}", "Bearer other", None]


@pytest.mark.parametrize("status", [301, 302, 303, 307, 308])
def test_a_redirect_does_not_get_the_key(server: AnswerServer, status: int):
    thief = AnswerServer()
    server.answers = [Response(status_code=status, headers={"Location": f"{thief.url}/maps"})]
    with Client(server.url, api_key=KEY) as client, pytest.raises(FirstfixError, match=str(status)):
        client.maps()
    assert len(keys_of(server)) == 1
    assert thief.requests == []
    thief.stop()


@pytest.mark.parametrize("key", ["a\r\nX-Injected: 1", "a b", "caf\u00e9", "a\x00b"])
def test_an_invalid_key_is_refused_and_not_repeated(key: str):
    with pytest.raises(InvalidOption) as refused:
        Client("http://127.0.0.1:1", api_key=key)
    assert key not in str(refused.value)
    assert credential(f" {KEY}\n") == KEY


def test_a_limited_caller_waits_and_asks_again(server: AnswerServer):
    limited = problem("rate_limited", 429, **{"Retry-After": "0"})
    server.answers = [limited, MAPS]
    with Client(server.url, retry=RetryPolicy(attempts=3, first_wait_s=0.01)) as client:
        assert client.maps() == []
    assert len(keys_of(server)) == 2
    server.answers = [limited]
    with (
        Client(server.url, retry=RetryPolicy(attempts=1)) as client,
        pytest.raises(RateLimited, match="because"),
    ):
        client.maps()
