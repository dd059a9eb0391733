"""Callers who ask too fast wait before any work is done. They count by name, strangers by address."""

from __future__ import annotations

import heapq
import re
import select
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import httpx
import pytest
from fastapi.routing import iter_route_contexts

from firstfix.access.api_keys import ApiKeys
from firstfix_service.app import create_app
from firstfix_service.auth.authenticate import Authenticator
from firstfix_service.http_api.edge import needs_of
from firstfix_service.http_server.streams import AnswerDelay
from firstfix_service.limits.limits import Limits
from firstfix_service.limits.turns import Turns
from firstfix_service.settings import Settings
from tests.service.access_world import API_PAGE, CONSOLE, known, localize
from tests.service.raw_connection import all_of, connect
from tests.service.service_world import Service, publish, running_service
from tests.waiting import wait_until


class Clock:
    """A clock that stands until it is set."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


PROXY = ("127.0.0.0/8",)
SCOPES = ("localize", "build", "metrics", "admin")


def every_route() -> list[tuple[str, str]]:
    """Method and path of all that the app answers: a new route is among them by itself."""
    found = set()
    for route in iter_route_contexts(create_app(Settings(store="memory://")).routes):
        found |= {(method, str(route.path)) for method in route.methods or ()}
    return sorted(found)


def keyed_routes() -> list[tuple[str, str]]:
    found = set()
    for route in iter_route_contexts(create_app(Settings(store="memory://", metrics_public=False)).routes):
        needs = needs_of({"endpoint": route.endpoint})
        if needs is not None and not needs.has_queue:
            found |= {(method, str(route.path)) for method in route.methods or ()}
    return sorted(found)


@pytest.fixture
def held(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Records for how many seconds requests should wait, and lets them go at once."""
    seen: list[float] = []

    async def wait(delay: AnswerDelay, seconds: float) -> bool:
        seen.append(seconds)
        return True

    monkeypatch.setattr(AnswerDelay, "wait", wait)
    return seen


@pytest.fixture
def waiting(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Lets requests wait as good as for ever. Records when a wait has begun, and how it has ended."""
    seen: list[str] = []
    wait = AnswerDelay.wait

    async def record(delay: AnswerDelay, seconds: float) -> bool:
        seen.append("begun")
        lasted = await wait(delay, 1e6)
        seen.append("over" if lasted else "gone")
        return lasted

    monkeypatch.setattr(AnswerDelay, "wait", record)
    return seen


@pytest.fixture
def worked(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Records the callers whose requests went on from their turn."""
    seen: list[str] = []
    permit = Authenticator.permit

    def record(self: Authenticator, caller: Any, *more: Any) -> None:
        seen.append(caller.name)
        permit(self, caller, *more)

    monkeypatch.setattr(Authenticator, "permit", record)
    return seen


@pytest.fixture
def slow(tmp_path: Path) -> Iterator[Service]:
    """A service that lets everybody ask once, and then as good as never."""
    with running_service(
        tmp_path,
        auth="on",
        keys_refresh_s=0.1,
        requests_per_s=1e-3,
        trusted_proxies=PROXY,
        metrics_public=False,
        zenoh=False,
    ) as service:
        yield service


@pytest.fixture
def flooder(slow: Service) -> str:
    """Its key."""
    return known(slow, "localize")


def request_of(path: str, key: str) -> bytes:
    return f"GET {path} HTTP/1.1\r\nHost: a\r\nAuthorization: Bearer {key}\r\n\r\n".encode()


def ask(
    service: Service, path: str, key: str | None, address: str = "192.0.2.9", method: str = "GET"
) -> httpx.Response:
    headers = {"X-Forwarded-For": address} | ({"Authorization": f"Bearer {key}"} if key else {})
    return service.http.request(method, path, headers=headers)


@pytest.mark.parametrize("path", ["/nothing", "/maps", "/openapi.json", "/console/nothing"])
@pytest.mark.parametrize("key", [None, "wrong"])
def test_a_stranger_waits_after_its_burst_and_others_do_not(slow: Service, held, path: str, key: str | None):
    robot = known(slow, "localize")
    ask(slow, path, key, "192.0.2.1")
    assert not held
    refused = ask(slow, path, key, "192.0.2.1")
    assert refused.status_code in (200, 401, 404), "it is answered all the same"
    assert held == [Limits.max_unauthenticated_wait_s]
    ask(slow, path, key, "192.0.2.2")
    assert len(held) == 1, "another address"
    assert ask(slow, "/maps", robot, "192.0.2.1").is_success
    assert len(held) == 1, "robots share addresses"


@pytest.mark.parametrize("scopes", [("localize",), SCOPES])
def test_every_route_waits_before_its_work_when_its_caller_is_over_its_credit(
    slow: Service, held, worked, scopes: tuple[str, ...]
):
    flooder, robot = known(slow, *scopes), known(slow, "localize")
    ask(slow, "/caller", flooder)
    for method, path in keyed_routes():
        filled = re.sub(r"{[^}]*}", "nothing", path)
        held.clear()
        worked.clear()
        if path.endswith("/events") and "build" in scopes:
            with slow.http.stream(method, filled, headers={"Authorization": f"Bearer {flooder}"}):
                pass
        else:
            ask(slow, filled, flooder, method=method)
        assert held == [Limits.max_wait_s], (method, path)
        assert len(worked) <= 1, "its permission is looked at after the wait"
    held.clear()
    assert ask(slow, "/maps", robot).is_success
    assert not held, "another caller does not wait"


def test_the_checked_routes_are_all_but_the_public_ones():
    routes = keyed_routes()
    assert {("GET", "/sensors"), ("GET", "/metrics"), ("POST", "/maps"), ("DELETE", "/keys/{key_id}")} <= set(
        routes
    )
    others = {path for _, path in every_route()} - {path for _, path in routes} - CONSOLE
    by_the_workers = {"/localize", "/scan-report", "/maps/{map_id}/versions/{version}/overlay"}
    assert others == by_the_workers | {"/healthz", "/readyz", "/openapi.json", *API_PAGE}


def test_a_waiting_request_does_no_work(slow: Service, waiting, worked, flooder: str):
    robot, other = known(slow, "localize"), known(slow, "localize")
    ask(slow, "/caller", flooder)
    worked.clear()
    with connect(slow) as over:
        over.sendall(request_of("/sensors", flooder))
        wait_until(lambda: waiting.count("begun") == 1)
        assert ask(slow, "/caller", robot).is_success
        assert len(worked) == 1, "the other caller alone"
    wait_until(lambda: waiting == ["begun", "gone"])
    assert ask(slow, "/caller", other).is_success
    assert len(worked) == 2, "nor after it has gone"


def test_a_key_that_is_revoked_while_its_request_waits_is_refused(
    slow: Service, worked, flooder: str, monkeypatch: pytest.MonkeyPatch
):
    async def revoke(delay: AnswerDelay, seconds: float) -> bool:
        ApiKeys(slow.catalog.store).revoke(flooder.split("_")[1])
        slow.app.state.start.parts[Authenticator].keys.refresh()
        return True

    ask(slow, "/caller", flooder)
    worked.clear()
    monkeypatch.setattr(AnswerDelay, "wait", revoke)
    assert ask(slow, "/caller", flooder).status_code == 401
    assert not worked


@pytest.mark.parametrize("path", ["/sensors", "/maps", "/recorded-queries", "/caller"])
def test_one_answer_to_250_connections_of_one_key_goes_before_that_of_another(
    slow: Service, waiting, flooder: str, path: str
):
    robot = known(slow, "localize")
    with ExitStack() as stack:
        flood = [stack.enter_context(connect(slow)) for _ in range(250)]
        for one in flood:
            one.sendall(request_of(path, flooder))
        assert ask(slow, "/maps", robot).is_success
        wait_until(lambda: len(waiting) == 249)
        answered = [one for one in flood if select.select([one], [], [], 0)[0]]
    assert len(answered) == 1
    wait_until(lambda: waiting.count("gone") == 249)


def test_connections_of_one_caller_together_keep_to_the_rate():
    """Counts answers of a flood by a clock of its own: each connection asks as soon as it has its answer."""
    clock = Clock()
    rate = Turns(Limits(), clock).rate_of("key:flooder")
    asking = [(0.0, number) for number in range(250)]
    answered = 0
    while asking[0][0] < 60.0:
        clock.now, number = heapq.heappop(asking)
        answered += 1
        heapq.heappush(asking, (clock.now + rate.take("key:flooder"), number))
    assert answered <= Limits.requests_per_s * (Limits.request_burst_s + 60.0) + 250
    assert rate.take("key:robot") == 0.0


def test_a_query_within_its_rate_does_not_wait_and_its_refusals_do(tmp_path: Path, held):
    with running_service(
        tmp_path, auth="on", keys_refresh_s=0.1, requests_per_s=1e-3, localize_per_s=2.0, zenoh=False
    ) as service:
        publish(service.catalog, "hall", "1", tmp_path / "made")
        robot = known(service, "localize")
        wait_until(lambda: localize(service, robot).is_success)
        held.clear()
        statuses = [localize(service, robot).status_code for _ in range(12)]
        refused = statuses.count(429)
        assert refused
        assert refused + statuses.count(200) == 12
        assert len(held) in (refused, refused - 1), "its first refusal is within its credit"
        for query in ("?map=none", "?map=hall&nonsense=1"):
            held.clear()
            assert localize(service, robot, query).is_client_error
            assert held == [Limits.max_wait_s]


def test_without_credentials_callers_are_addresses(tmp_path: Path, held):
    with running_service(tmp_path, requests_per_s=1e-3, trusted_proxies=PROXY, zenoh=False) as service:
        for _ in range(2):
            assert ask(service, "/sensors", None, "192.0.2.1").is_success
        assert held == [Limits.max_wait_s]
        assert ask(service, "/sensors", None, "192.0.2.2").is_success
        assert held == [Limits.max_wait_s]


def test_probes_wait_for_a_short_time_alone(slow: Service, held):
    for _ in range(3):
        ask(slow, "/nothing", None)
    assert set(held) == {Limits.max_unauthenticated_wait_s}
    held.clear()
    for _ in range(3):
        assert ask(slow, "/healthz", None).is_success
    assert set(held) == {Limits.max_probe_wait_s}


def test_a_stranger_that_waits_gives_its_place_to_another(tmp_path: Path, waiting):
    with running_service(tmp_path, auth="on", requests_per_s=1e-5, max_connections=1, zenoh=False) as service:
        request = b"GET /nothing HTTP/1.1\r\nHost: a\r\n\r\n"
        with connect(service) as first:
            first.sendall(request)
            assert b"404" in first.recv(1 << 16)
            first.sendall(request)
            with connect(service) as second:
                second.sendall(b"GET /healthz HTTP/1.1\r\nHost: a\r\nConnection: close\r\n\r\n")
                assert b"200 OK" in all_of(second)
            assert all_of(first) == b""
