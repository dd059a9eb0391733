"""Connections of callers that are slow, silent or many, or do not read: they end, and others find a place."""

from __future__ import annotations

import os
import resource
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from pathlib import Path

import httpx
import pytest

from firstfix_service.limits import connections
from firstfix_service.limits.limits import Limits
from firstfix_service.settings import Settings
from tests.service.access_world import give
from tests.service.service_world import (
    SCAN_BODY,
    XYZ,
    Behaviour,
    Service,
    free_port,
    publish,
    running_service,
)
from tests.waiting import LIMIT_S, let_pass, wait_until

pytestmark = pytest.mark.slow

GET = b"GET /healthz HTTP/1.1\r\nHost: x\r\n"
SHORT = {
    "head_timeout_s": 0.5,
    "keep_alive_s": 0.5,
    "body_timeout_s": 0.5,
    "answer_timeout_s": 0.5,
    "linger_s": 0.5,
}
DRIP_S = 0.1
OTHER_ADDRESS = "127.0.0.9"


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connections, "CHECK_S", 0.1)


@pytest.fixture
def guarded(tmp_path: Path) -> Iterator[Service]:
    with running_service(tmp_path, zenoh=False, auth="on", keys_refresh_s=0.1, **SHORT) as running:
        yield running


def connect(service: Service, source: str = "127.0.0.1") -> socket.socket:
    port = int(service.url.rpartition(":")[2])
    return socket.create_connection(("127.0.0.1", port), timeout=LIMIT_S, source_address=(source, 0))


def is_closed_while_dripping(connection: socket.socket, drop: bytes) -> bool:
    """Returns whether the service closes a connection in both directions, although data drips in."""
    for _ in range(round(LIMIT_S / DRIP_S)):
        try:
            connection.sendall(drop)
        except ConnectionError:
            return True
        let_pass(DRIP_S)
    return False


def ended(service: Service, why: str) -> float:
    registry = service.app.state.metrics.registry
    return registry.get_sample_value("firstfix_http_connections_ended_total", {"why": why}) or 0.0


def test_a_body_that_drips_after_its_refusal_does_not_hold_the_connection(guarded: Service):
    with connect(guarded) as connection:
        connection.sendall(b"POST /maps HTTP/1.1\r\nHost: x\r\nContent-Length: 100000\r\n\r\n")
        answer = connection.recv(1 << 16)
        assert answer.startswith(b"HTTP/1.1 401")
        assert b"connection: close" in answer
        assert is_closed_while_dripping(connection, b"x")
    assert ended(guarded, "unread") == 1


def test_empty_lines_between_requests_do_not_hold_the_connection(guarded: Service):
    with connect(guarded) as connection:
        connection.sendall(GET + b"\r\n")
        assert connection.recv(1 << 16).startswith(b"HTTP/1.1 200")
        assert is_closed_while_dripping(connection, b"\r\n")


def test_a_head_that_drips_does_not_hold_the_connection(guarded: Service):
    with connect(guarded) as first:
        first.sendall(GET + b"X-A: ")
        assert is_closed_while_dripping(first, b"a")
    with connect(guarded) as next_one:
        next_one.sendall(GET + b"\r\n" + GET)
        assert next_one.recv(1 << 16).startswith(b"HTTP/1.1 200")
        assert is_closed_while_dripping(next_one, b"X-A: b\r\n")
    assert ended(guarded, "head") == 2


def test_silence_does_not_hold_the_connection(guarded: Service):
    with connect(guarded) as connection:
        assert connection.recv(1) == b""


def test_a_body_that_drips_within_every_stall_limit_does_not_hold_the_connection(guarded: Service):
    headers = {"Authorization": f"Bearer {give(guarded, 'build')}"}
    announced = {"Upload-Length": "100000", "Upload-Metadata": "filename aGFsbC5wbHk="}
    wait_until(lambda: guarded.http.get("/builds", headers=headers).is_success)
    where = guarded.http.post("/uploads", headers={**headers, **announced}).headers["location"]
    with connect(guarded) as connection:
        connection.sendall(
            f"PATCH {where} HTTP/1.1\r\nHost: x\r\nAuthorization: {headers['Authorization']}\r\n"
            "Content-Type: application/offset+octet-stream\r\nUpload-Offset: 0\r\n"
            "Content-Length: 100000\r\n\r\n".encode()
        )
        assert is_closed_while_dripping(connection, b"x")


def test_a_caller_that_does_not_take_in_its_answers_is_cut_off(guarded: Service):
    with connect(guarded) as connection:
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        connection.settimeout(DRIP_S)

        def is_cut_off_while_asking() -> bool:
            with suppress(TimeoutError, ConnectionError):
                connection.sendall(b"GET /openapi.json HTTP/1.1\r\nHost: x\r\n\r\n")
            return ended(guarded, "answer") == 1

        wait_until(is_cut_off_while_asking)
    wait_until(lambda: guarded.http.get("/healthz").is_success)


def test_a_caller_that_is_still_sending_gets_an_early_answer(guarded: Service):
    size = 13 << 20
    with connect(guarded) as connection:
        connection.sendall(b"POST /maps HTTP/1.1\r\nHost: x\r\nContent-Length: %d\r\n\r\n" % size)
        connection.sendall(bytes(size))
        assert connection.recv(1 << 16).startswith(b"HTTP/1.1 401")


def test_a_connection_is_kept_for_the_next_request(guarded: Service):
    body = b"GET /healthz HTTP/1.1\r\nHost: x\r\nContent-Length: 3\r\n\r\nabc"
    with connect(guarded) as connection:
        for _ in range(3):
            connection.sendall(body)
            assert connection.recv(1 << 16).startswith(b"HTTP/1.1 200")


def silent(service: Service, count: int, stack: ExitStack, source: str = OTHER_ADDRESS) -> None:
    for _ in range(count):
        stack.enter_context(connect(service, source))


def test_an_address_at_its_limit_keeps_its_newest_connection(tmp_path: Path):
    with (
        running_service(tmp_path, zenoh=False, max_connections_per_address=5) as service,
        ExitStack() as stack,
    ):
        silent(service, 50, stack)
        wait_until(lambda: ended(service, "room") == 45)
        with connect(service, OTHER_ADDRESS) as newest:
            newest.sendall(GET + b"\r\n")
            assert newest.recv(1 << 16).startswith(b"HTTP/1.1 200")
        assert service.http.get("/healthz").is_success


def test_a_trusted_proxy_has_no_limit_of_its_own(tmp_path: Path):
    limits = {"max_connections_per_address": 5, "trusted_proxies": (f"{OTHER_ADDRESS}/32",)}
    with running_service(tmp_path, zenoh=False, **limits) as service, ExitStack() as stack:
        kept = [stack.enter_context(connect(service, OTHER_ADDRESS)) for _ in range(30)]
        for connection in kept:
            connection.sendall(GET + b"\r\n")
            assert connection.recv(1 << 16).startswith(b"HTTP/1.1 200")


def test_a_waiting_connection_makes_way_for_a_new_one(tmp_path: Path):
    limits = {"max_connections": 10, "max_connections_per_address": 0}
    with running_service(tmp_path, zenoh=False, **limits) as service, ExitStack() as stack:
        assert service.http.get("/healthz").is_success
        service.http.close()  # its connection waits too, and may be ended while it is used again
        for n in range(10):
            silent(service, 5, stack, f"127.0.0.{10 + n}")
        assert httpx.get(service.url + "/maps", timeout=LIMIT_S).is_success
        wait_until(lambda: ended(service, "room") >= 40)


@pytest.mark.parametrize("limited", ["max_connections", "max_connections_per_address"])
def test_the_health_finds_a_place_among_callers_that_are_all_being_served(tmp_path: Path, limited: str):
    behaviour = Behaviour(gate=threading.Event())
    limits = {"max_connections_per_address": 0, limited: 4, "behaviour": behaviour}
    with running_service(tmp_path, zenoh=False, **limits) as service, ExitStack() as stack:
        publish(service.catalog, "hall", "1", service.scratch)
        wait_until(lambda: service.http.get("/readyz").json().get("maps") == 1)
        service.http.close()
        for _ in range(4):
            asking = stack.enter_context(connect(service))
            head = f"POST /localize?map=hall HTTP/1.1\r\nHost: x\r\nContent-Type: {XYZ}\r\n"
            asking.sendall(f"{head}Content-Length: {len(SCAN_BODY)}\r\n\r\n".encode() + SCAN_BODY)
        wait_until(
            lambda: service.app.state.metrics.registry.get_sample_value("firstfix_queries_admitted") == 4
        )
        for path, status in (("/healthz", 200), ("/readyz", 200), ("/maps", 503), ("/healthz", 200)):
            assert httpx.get(service.url + path, timeout=LIMIT_S).status_code == status


def test_places_follow_from_the_limit_of_open_files():
    def places(open_files: int) -> tuple[int, int]:
        limits = Limits.of(Settings(store="memory://"), open_files)
        return limits.max_connections, limits.max_connections_per_address

    assert places(256) == (112, 56)
    assert places(1024) == (752, 256)
    assert places(resource.RLIM_INFINITY) == (4096, 256)


def test_connections_do_not_use_up_the_files_that_the_store_needs(tmp_path: Path):
    (tmp_path / "store").mkdir()
    port = free_port()
    given = {
        "FIRSTFIX_STORE": tmp_path / "store",
        "FIRSTFIX_PORT": port,
        "FIRSTFIX_CACHE_DIR": tmp_path / "cache",
        "FIRSTFIX_WORK_DIR": tmp_path / "work",
    }
    url = f"http://127.0.0.1:{port}"
    with ExitStack() as stack:
        process = subprocess.Popen(
            [sys.executable, Path(__file__).parents[1] / "replica_process.py"],
            env={**os.environ, **{name: str(value) for name, value in given.items()}},
            preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_NOFILE, (256, 256)),
        )
        stack.callback(process.wait)
        stack.callback(process.kill)
        wait_until(lambda: status_of(f"{url}/readyz") == 200)
        for sources in (["127.0.0.1"], [f"127.0.0.{n}" for n in range(10, 210)]):
            for n in range(300):
                held = socket.create_connection(("127.0.0.1", port), LIMIT_S, (sources[n % len(sources)], 0))
                stack.enter_context(held).sendall(b"POST /maps HTTP/1.1\r\nHost: x\r\n")
            for _ in range(3):
                assert status_of(f"{url}/healthz") == 200
                assert status_of(f"{url}/maps") == 200, "the store can be read"


def status_of(url: str) -> int:
    try:
        return httpx.get(url, timeout=LIMIT_S).status_code
    except httpx.TransportError:
        return 0
