"""The response budget: callers that do not read them take neither memory nor turns from others."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import httpx
import pytest

from firstfix.catalog.manifest import CLOUD_INDEX, CLOUD_POINTS, Manifest
from firstfix_service.limits import connections
from firstfix_service.limits.limits import Limits
from tests.service.access_world import give
from tests.service.service_world import Service, running_service
from tests.waiting import LIMIT_S, wait_until

pytestmark = pytest.mark.slow

POINTS, SIZE = 500_000, 4_000_000
LIMIT_BYTES = 32 * SIZE // 7 + 8  # one such answer for a caller, two for an address, four for all


@contextmanager
def serving(directory: Path, **changes: object) -> Iterator[Service]:
    with running_service(directory, zenoh=False, max_unsent_bytes=LIMIT_BYTES, **changes) as service:
        folder = service.scratch / "large"
        folder.mkdir(parents=True)
        (folder / "label.txt").write_text("7")
        (folder / CLOUD_POINTS).write_bytes(bytes(SIZE))
        (folder / CLOUD_INDEX).write_bytes(b'"%s"' % (b"x" * SIZE))
        service.catalog.publish("hall", folder, Manifest.for_directory(folder))
        yield service


def points_of(service: Service) -> str:
    version = service.catalog.active_version("hall")
    return f"/maps/hall/versions/{version}/cloud/points?first=0&count={POINTS}"


def ask(service: Service, stack: ExitStack, source: str, path: str = "", key: str = "") -> socket.socket:
    """Asks for a large answer on a connection that takes little in."""
    connection = stack.enter_context(socket.socket())
    connection.settimeout(LIMIT_S)
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    connection.bind((source, 0))
    connection.connect(("127.0.0.1", int(service.url.rpartition(":")[2])))
    head = f"GET {path or points_of(service)} HTTP/1.1\r\nHost: x\r\n"
    credential = f"Authorization: Bearer {key}\r\n" if key else ""
    connection.sendall(f"{head}{credential}\r\n".encode())
    return connection


def get(service: Service, path: str, source: str, key: str = "") -> httpx.Response:
    transport = httpx.HTTPTransport(local_address=source)
    headers = {"Authorization": f"Bearer {key}"} if key else {}
    with httpx.Client(base_url=service.url, transport=transport, headers=headers, timeout=LIMIT_S) as http:
        return http.get(path)


def unsent_bytes(service: Service) -> float:
    return service.app.state.metrics.registry.get_sample_value("firstfix_unsent_bytes") or 0.0


def parts_read(service: Service) -> float:
    labels = {"operation": "get_range"}
    registry = service.app.state.metrics.registry
    return registry.get_sample_value("firstfix_store_seconds_count", labels) or 0.0


def refusal(answer: httpx.Response) -> tuple[int, str]:
    assert int(answer.headers["retry-after"]) > 0
    assert answer.headers["x-request-id"]
    return answer.status_code, answer.json()["code"]


def test_only_a_caller_that_does_not_read_is_refused(tmp_path: Path):
    with serving(tmp_path) as service, ExitStack() as stack:
        waiting = ask(service, stack, "127.0.0.9")
        wait_until(lambda: unsent_bytes(service) == SIZE and parts_read(service) == 1)
        assert refusal(get(service, points_of(service), "127.0.0.9")) == (429, "quota_exceeded")
        assert parts_read(service) == 1, "refused before it was read"
        assert get(service, "/caller", "127.0.0.9").is_success
        assert len(get(service, points_of(service), "127.0.0.8").content) == SIZE
        waiting.close()
        wait_until(lambda: unsent_bytes(service) == 0)
        assert len(get(service, points_of(service), "127.0.0.9").content) == SIZE


def test_all_callers_together_have_a_limit(tmp_path: Path):
    with serving(tmp_path) as service, ExitStack() as stack:
        for number in range(4):
            ask(service, stack, f"127.0.0.{10 + number}")
        wait_until(lambda: unsent_bytes(service) == 4 * SIZE and parts_read(service) == 4)
        assert refusal(get(service, points_of(service), "127.0.0.9")) == (503, "overloaded")
        assert parts_read(service) == 4, "refused before it was read"
        assert refusal(get(service, points_of(service).replace("/points", ""), "127.0.0.9"))[0] == 503
        assert len(get(service, "/openapi.json", "127.0.0.9").content) > 65_536, "in memory in any case"
        assert get(service, "/maps", "127.0.0.9").is_success


def test_an_address_has_a_limit_for_all_its_keys(tmp_path: Path):
    with serving(tmp_path, auth="on", keys_refresh_s=0.1) as service, ExitStack() as stack:
        keys = [give(service, "localize") for _ in range(3)]
        for key in keys:
            wait_until(lambda key=key: get(service, "/caller", "127.0.0.9", key).is_success)
        for number, key in enumerate(keys[:2], 1):
            ask(service, stack, "127.0.0.9", key=key)
            wait_until(lambda number=number: unsent_bytes(service) == number * SIZE)
        assert refusal(get(service, points_of(service), "127.0.0.9", keys[2])) == (429, "quota_exceeded")
        assert len(get(service, points_of(service), "127.0.0.8", keys[2]).content) == SIZE
        assert refusal(get(service, points_of(service), "127.0.0.8", keys[0])) == (429, "quota_exceeded")


def test_an_unmeasured_answer_counts_for_the_limit(tmp_path: Path):
    """A small one has a place for longer: operators look at metrics when others take all the room."""
    with serving(tmp_path) as service, ExitStack() as stack:
        for number in range(4):
            ask(service, stack, f"127.0.0.{10 + number}")
        wait_until(lambda: unsent_bytes(service) == 4 * SIZE)
        series = service.app.state.metrics.http_requests
        for many, is_small in ((2000, True), (7000, False)):
            for number in range(many):
                series.labels("GET", f"/made/up/{number}", "200").inc()
            answer = get(service, "/metrics", "127.0.0.9")
            if is_small:
                assert 65_536 < len(answer.content) < Limits.small_answer_bytes
            else:
                assert refusal(answer) == (503, "overloaded")


def test_a_reader_below_the_pace_is_cut_off(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(connections, "CHECK_S", 0.1)
    with serving(tmp_path, answer_timeout_s=0.5) as service, ExitStack() as stack:
        slow = ask(service, stack, "127.0.0.9")
        registry = service.app.state.metrics.registry

        def is_cut_off_while_reading() -> bool:
            try:
                slow.recv(100)
            except ConnectionError:
                return True
            labels = {"why": "answer"}
            return registry.get_sample_value("firstfix_http_connections_ended_total", labels) == 1

        wait_until(is_cut_off_while_reading)
        wait_until(lambda: unsent_bytes(service) == 0)


def test_large_answers_are_complete_on_a_kept_connection(tmp_path: Path):
    with serving(tmp_path) as service:
        index = points_of(service).replace("/points", "")
        for path, size in ((points_of(service), SIZE), (index, SIZE + 2), ("/healthz", 2)) * 2:
            assert len(service.http.get(path).content) >= size
        assert service.http.head("/console/").status_code in (200, 404)
        wait_until(lambda: unsent_bytes(service) == 0)
