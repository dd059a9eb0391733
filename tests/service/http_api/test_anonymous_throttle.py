"""Strangers who ask too fast wait for their answers. Callers never do."""

from __future__ import annotations

from pathlib import Path

import httpx
import pytest
from access_world import give
from raw_connection import all_of, connect
from service_world import running_service

from firstfix_service.http_api import edge
from firstfix_service.http_api.edge import MAX_DELAY_S, MAX_PROBE_DELAY_S
from firstfix_service.http_server.streams import AnswerDelay
from waiting import wait_until

PROXY = ("127.0.0.0/8",)


@pytest.fixture
def held(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Records for how many seconds answers should wait, and lets them go at once."""
    seen: list[float] = []

    async def wait(delay: AnswerDelay, seconds: float) -> None:
        seen.append(seconds)

    monkeypatch.setattr(AnswerDelay, "wait", wait)
    return seen


@pytest.mark.parametrize("path", ["/nothing", "/maps", "/openapi.json", "/console/nothing"])
@pytest.mark.parametrize("key", [None, "wrong"])
def test_a_stranger_waits_after_its_burst_and_others_do_not(tmp_path: Path, held, path: str, key: str | None):
    with running_service(
        tmp_path, auth="on", keys_refresh_s=0.1, strangers_per_s=0.1, trusted_proxies=PROXY, zenoh=False
    ) as service:

        def ask(path: str, key: str | None, address: str) -> httpx.Response:
            headers = {"X-Forwarded-For": address} | ({"Authorization": f"Bearer {key}"} if key else {})
            return service.http.get(path, headers=headers)

        robot = give(service, "localize")
        wait_until(lambda: ask("/maps", robot, "192.0.2.9").is_success)
        held.clear()
        ask(path, key, "192.0.2.1")
        assert not held
        refused = ask(path, key, "192.0.2.1")
        assert refused.status_code in (200, 401, 404), "it is answered all the same"
        assert held == [MAX_DELAY_S]
        ask(path, key, "192.0.2.2")
        assert len(held) == 1, "another address"
        for _ in range(3):
            assert ask("/maps", robot, "192.0.2.1").is_success
        assert len(held) == 1, "robots share addresses"


def test_probes_wait_for_a_short_time_alone(tmp_path: Path, held):
    with running_service(tmp_path, auth="on", strangers_per_s=0.01, zenoh=False) as service:
        held.clear()
        for _ in range(3):
            service.http.get("/nothing")
        assert set(held) == {MAX_DELAY_S}
        held.clear()
        for _ in range(3):
            assert service.http.get("/healthz").is_success
        assert set(held) == {MAX_PROBE_DELAY_S}


def test_a_stranger_that_waits_gives_its_place_to_another(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(edge, "MAX_DELAY_S", 1e6)
    with running_service(
        tmp_path, auth="on", strangers_per_s=1e-5, max_connections=1, zenoh=False
    ) as service:
        request = b"GET /nothing HTTP/1.1\r\nHost: a\r\n\r\n"
        with connect(service) as first:
            first.sendall(request)
            assert b"404" in first.recv(1 << 16)
            first.sendall(request)
            with connect(service) as second:
                second.sendall(b"GET /healthz HTTP/1.1\r\nHost: a\r\nConnection: close\r\n\r\n")
                assert b"200 OK" in all_of(second)
            assert all_of(first) == b""
