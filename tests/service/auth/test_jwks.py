"""Keys of a real issuer on loopback: fetched, changed, missing, and malformed."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from firstfix.errors import FirstfixError, InvalidOption, Overloaded, Unauthorized
from firstfix_service.auth import jwks as jwks_module
from firstfix_service.auth.jwks import Jwks
from tests.service.service_world import publish, running_service
from tests.service.token_world import AUDIENCE, ISSUER, OTHER, Issuer, key_set, signed
from tests.waiting import wait_until, wait_until_async


@pytest.mark.parametrize(
    "url",
    ["http://login.example.org/keys", "ftp://login.example.org/keys", "https:///keys"]
    + ["https://user:secret@login.example.org/keys", "http://127.0.0.1.example.org/keys"],
)
def test_keys_come_over_https(url: str):
    with pytest.raises(InvalidOption) as refused:
        Jwks(url)
    assert "secret@" not in str(refused.value)


@pytest.fixture
def issuer() -> Iterator[Issuer]:
    running = Issuer()
    yield running
    if running.gate is not None:
        running.gate.set()
    running.server.shutdown()
    running.server.server_close()


class Clock:
    now = 1000.0

    def __call__(self) -> float:
        return self.now


def test_a_new_key_of_the_issuer_is_fetched_but_seldom(issuer: Issuer):
    async def scenario() -> None:
        clock = Clock()
        keys = Jwks(issuer.url, clock)
        assert await keys.key("es256", "ES256")
        assert issuer.asked == 1
        issuer.document = key_set(new=(OTHER, "ES256"))
        for _ in range(5):
            with pytest.raises(Unauthorized):
                await keys.key("new", "ES256")
        assert issuer.asked == 1, "made-up key ids do not make this service a flood"
        clock.now += 10.0
        assert await keys.key("new", "ES256")
        with pytest.raises(Unauthorized):
            await keys.key("es256", "ES256")
        assert issuer.asked == 2

    asyncio.run(scenario())


def test_who_comes_while_keys_are_fetched_waits_for_the_same_answer(issuer: Issuer):
    async def scenario() -> None:
        issuer.gate = threading.Event()
        keys = Jwks(issuer.url)
        waiting = [asyncio.create_task(keys.key("es256", "ES256")) for _ in range(20)]
        await wait_until_async(lambda: issuer.asked)
        issuer.gate.set()
        assert all(await asyncio.gather(*waiting))
        assert issuer.asked == 1

    asyncio.run(scenario())


BAD_ANSWERS: dict[str, dict[str, Any]] = {
    "status": {"status": 500},
    "redirect": {"status": 302, "headers": {"Location": "http://127.0.0.1:1/"}},
    "not json": {"document": b"<html>"},
    "no set": {"document": {"keys": {}}},
    "a list": {"document": []},
    "deep": {"document": b"[" * 100_000},
    "endless": {"document": b" " * 300_000},
    "too many keys": {"document": {"keys": [{}] * 101}},
    "a secret": {"document": {"keys": [{"kty": "oct", "k": "c2VjcmV0", "kid": "es256"}]}},
}


@pytest.mark.parametrize("case", BAD_ANSWERS)
def test_a_bad_answer_leaves_the_keys_as_they_are(issuer: Issuer, case: str):
    async def scenario() -> None:
        keys = Jwks(issuer.url)
        await keys.refresh()
        vars(issuer).update(BAD_ANSWERS[case])
        await keys.refresh()
        assert issuer.asked == 2
        assert await keys.key("es256", "ES256")
        fresh = Jwks(issuer.url)
        with pytest.raises(Overloaded):
            await fresh.key("es256", "ES256")

    asyncio.run(scenario())


def test_keys_of_an_issuer_that_is_gone_serve_for_a_day(issuer: Issuer):
    async def scenario() -> None:
        clock = Clock()
        keys = Jwks(issuer.url, clock)
        await keys.refresh()
        issuer.status = 503
        clock.now += jwks_module.MAX_AGE_S - 1
        assert await keys.key("es256", "ES256")
        clock.now += 2
        with pytest.raises(Overloaded):
            await keys.key("es256", "ES256")

    asyncio.run(scenario())


def test_a_hanging_issuer_is_given_up(issuer: Issuer, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(jwks_module, "_TIMEOUT_S", 0.2)
    issuer.gate = threading.Event()

    async def scenario() -> None:
        with pytest.raises(FirstfixError):
            await Jwks(issuer.url).key("es256", "ES256")

    asyncio.run(scenario())


def test_a_service_takes_tokens_and_keys_side_by_side(tmp_path: Path, issuer: Issuer):
    chosen = {"jwt_jwks": issuer.url, "jwt_issuer": ISSUER, "jwt_audience": AUDIENCE, "auth": "on"}
    with running_service(tmp_path, **chosen, jwt_maps_claim="maps", zenoh=False) as service:
        publish(service.catalog, "hall", "1", service.scratch)

        def status(token: str, path: str = "/maps/hall") -> int:
            return service.http.get(path, headers={"Authorization": f"Bearer {token}"}).status_code

        wait_until(lambda: status(signed(maps="hall")) == 200)
        assert status(signed(maps="yard")) == 403
        assert status(signed(maps="hall"), "/metrics") == 403
        assert status(signed(maps="hall", scope="openid")) == 403
        assert status(signed(maps="hall", key=OTHER)) == 401
        assert status("ffx_0123456789ab_" + "0" * 64) == 401
