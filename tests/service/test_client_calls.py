"""Client calls against the real service; only its localizer is a fake."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import httpx
import pytest

from firstfix.builds.records import new_status
from firstfix.errors import ChecksumMismatch, DeadlineExceeded, NotFound
from firstfix_client import Client, RetryPolicy
from firstfix_client.steps import builds as build_steps
from tests.service.service_world import Service, publish, running_service

DATA = bytes(range(256)) * 200
QUICK = RetryPolicy(attempts=6, first_wait_s=0.01, max_wait_s=0.05)


@pytest.fixture
def service(tmp_path: Path) -> Iterator[Service]:
    with running_service(tmp_path, zenoh=False) as running:
        publish(running.catalog, "hall", "1", running.scratch)
        yield running


class Breaks(httpx.HTTPTransport):
    """A network that loses requests or answers, as the test says."""

    def __init__(self, loses: Callable[[int, httpx.Request], str | None]) -> None:
        super().__init__()
        self.loses, self.count, self.sent = loses, 0, 0

    def handle_request(self, request: httpx.Request) -> httpx.Response:
        self.count += 1
        what = self.loses(self.count, request)
        if what == "request":
            raise httpx.ConnectError("lost")
        if request.method == "PATCH":
            self.sent += int(request.headers["content-length"])
        response = super().handle_request(request)
        if what == "answer":
            response.close()
            raise httpx.ReadError("lost")
        return response


@pytest.fixture
def small_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(build_steps, "PART_BYTES", 5000)
    monkeypatch.setattr(build_steps, "IN_PARTS_FROM_BYTES", 10_000)


def file_of(tmp_path: Path, data: bytes = DATA) -> Path:
    path = tmp_path / "hall.xyz"
    path.write_bytes(data)
    return path


@pytest.mark.usefixtures("small_parts")
def test_a_large_file_goes_in_parts_over_a_bad_line(service: Service, tmp_path: Path):
    network = Breaks(lambda n, request: {0: "request", 1: "answer"}.get(n % 4))
    with Client(service.url, retry=QUICK, transport=network) as client:
        status = client.build_map(file_of(tmp_path), "hall", config={"level": False})
    request = service.catalog.builds.request(status.build_id)
    assert service.catalog.store.get(request["source"]["key"]) == DATA
    assert request["file_name"] == "hall.xyz"
    assert request["config"] == {"level": False}
    assert len(service.catalog.builds.ids()) == 1
    assert network.sent < 2 * len(DATA), "no part that arrived is sent again more than once"


@pytest.mark.usefixtures("small_parts")
def test_what_a_map_was_made_of_does_not_stay(service: Service, tmp_path: Path):
    with Client(service.url, retry=QUICK) as client:
        client.build_map(file_of(tmp_path), "hall", trajectory=file_of(tmp_path))
    assert service.catalog.store.list("uploads") == []


@pytest.mark.usefixtures("small_parts")
def test_a_file_that_changes_while_it_is_read_is_no_map(
    service: Service, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(build_steps, "_sha256", lambda path: "0" * 64)
    with Client(service.url, retry=QUICK) as client, pytest.raises(ChecksumMismatch):
        client.build_map(file_of(tmp_path), "hall")
    assert service.catalog.builds.ids() == []


def test_a_small_file_is_one_build_however_often_it_is_sent(service: Service, tmp_path: Path):
    network = Breaks(lambda n, request: "answer" if n <= 3 else None)
    with Client(service.url, retry=QUICK, transport=network) as client:
        client.build_map(file_of(tmp_path), "hall")
    assert len(service.catalog.builds.ids()) == 1


def test_a_build_tells_how_far_it_is(service: Service):
    service.catalog.builds.put("b1", {"map_id": "hall"})
    service.catalog.builds.put("b2", {"map_id": "attic"})
    with Client(service.url) as client:
        assert [build.build_id for build in client.builds()] == ["b2", "b1"]
        assert [build.build_id for build in client.builds(map_id="hall", state="queued")] == ["b1"]
        seen = []
        for status in client.build_events("b1"):
            seen.append(status.state)
            following = "running" if status.state == "queued" else "succeeded"
            service.catalog.builds.set_status("b1", new_status(following, map_id="hall"))
        assert seen == ["queued", "running", "succeeded"]
        with pytest.raises(NotFound):
            next(client.build_events("none"))
        with pytest.raises(DeadlineExceeded):
            list(client.build_events("b2", timeout_s=0.3))


def test_lists_longer_than_a_page(service: Service, monkeypatch: pytest.MonkeyPatch):
    for n in range(4):
        publish(service.catalog, f"m{n}", "1", service.scratch)
        publish(service.catalog, "hall", str(n + 2), service.scratch)

    class TwoAPage(httpx.HTTPTransport):
        def handle_request(self, request: httpx.Request) -> httpx.Response:
            request.url = request.url.copy_set_param("limit", "2")
            return super().handle_request(request)

    with Client(service.url, transport=TwoAPage()) as client:
        assert [info.map_id for info in client.maps()] == ["hall", "m0", "m1", "m2", "m3"]
        assert len(client.versions("hall")) == 5
