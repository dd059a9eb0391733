"""A query ends when its caller has gone: its worker is free at once, whatever was left to search."""

from __future__ import annotations

import json
import math
import os
import socket
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import pytest

from firstfix.answer.localization import Localization
from firstfix.answer.options import LocalizeOptions
from firstfix.catalog.catalog import Catalog
from firstfix.catalog.manifest import Manifest
from firstfix.engine.deadline import Deadline
from firstfix.errors import QueryCancelled
from firstfix.scan.scan import Scan
from firstfix.store.store import Store
from firstfix.wire.scan import MEDIA_TYPE, encode_scan
from tests.servers import free_port, running
from tests.service.raw_connection import connect
from tests.service.service_world import (
    SCAN_BODY,
    XYZ,
    Behaviour,
    FakeLocalizer,
    environment_of,
    publish,
    running_service,
)
from tests.waiting import LIMIT_S, wait_until

HELD_SEARCH = Path(__file__).with_name("held_search")
SERVE = """
from firstfix_service.server import serve
from firstfix_service.settings import Settings
serve(Settings())
"""
GONE = {"transport": "http", "code": "client_gone"}


def request(target: str, body: bytes, media_type: str) -> bytes:
    head = f"POST {target} HTTP/1.1\r\nHost: x\r\nContent-Type: {media_type}\r\nX-Request-Id: gone\r\n"
    return f"{head}Content-Length: {len(body)}\r\n\r\n".encode() + body


def search_without_end(
    one: FakeLocalizer, scan: Scan, options: LocalizeOptions, deadline: Deadline
) -> Localization:
    """Answers a scan of ten points; the search for any other ends when it is cancelled."""
    if len(scan) == 10:
        return one.found(scan)
    wait_until(lambda: deadline.cancellation.is_requested)
    deadline.check_wanted()
    raise AssertionError("it is cancelled")


@pytest.mark.parametrize("transport", ["http", "zenoh"])
def test_a_query_past_its_deadline_ends_in_its_worker(tmp_path: Path, transport: str):
    """So does one of zenoh, where a caller that waits no more is known by its deadline alone."""
    with running_service(
        tmp_path, behaviour=Behaviour(answers=search_without_end), workers=1, queue_size=0
    ) as service:
        publish(service.catalog, "hall", "1", service.scratch)
        assert service.ask(transport, body=SCAN_BODY[:120]).ok
        reply = service.ask(transport, options={"deadline_ms": "300"})
        assert (reply.json["code"], reply.json["status"]) == ("deadline_exceeded", 504)
        wait_until(lambda: service.value("firstfix_queries_admitted") == 0)
        assert service.ask(transport, body=SCAN_BODY[:120]).ok


def test_a_query_whose_caller_has_gone_is_counted_once_and_logged(tmp_path: Path, capsys: Any):
    with running_service(
        tmp_path, behaviour=Behaviour(answers=search_without_end), workers=1, queue_size=0
    ) as service:
        publish(service.catalog, "hall", "1", service.scratch)
        assert service.ask_http(body=SCAN_BODY[:120]).ok
        with connect(service) as connection:
            connection.sendall(request("/localize?map=hall", SCAN_BODY, XYZ))
            wait_until(
                lambda: (
                    service.behaviour.started.acquire(blocking=False) and service.behaviour.started.acquire()
                )
            )
        wait_until(lambda: service.value("firstfix_queries_admitted") == 0)
        assert service.value("firstfix_localize_failures_total", **GONE) == 1
        assert (
            service.value("firstfix_localize_failures_total", transport="http", code=QueryCancelled.code) == 0
        )
        assert service.ask_http(body=SCAN_BODY[:120]).ok
        assert service.value("firstfix_body_bytes") == 0


@dataclass
class RealService:
    """A service process whose worker holds its searches until they are cancelled."""

    url: str
    held: Path
    log: Path

    @property
    def searches(self) -> list[str]:
        """Numbers of maps of the searches that were held."""
        return self.held.read_text().split() if self.held.exists() else []

    @property
    def lines_of_gone(self) -> list[dict[str, Any]]:
        """Log lines of requests whose caller has gone."""
        lines = map(json.loads, filter(lambda line: line.startswith("{"), self.log.read_text().splitlines()))
        return [line for line in lines if line.get("status") == 499]

    def connect(self) -> socket.socket:
        return socket.create_connection(("127.0.0.1", int(self.url.rpartition(":")[2])), timeout=LIMIT_S)

    def value(self, name: str, **labels: str) -> float:
        named = ",".join(f'{key}="{value}"' for key, value in sorted(labels.items()))
        start = f"{name}{{{named}}} " if labels else f"{name} "
        lines = httpx.get(f"{self.url}/metrics", timeout=LIMIT_S).text.splitlines()
        return next((float(line.rpartition(" ")[2]) for line in lines if line.startswith(start)), math.nan)


@pytest.fixture(scope="module")
def real(small_version, tmp_path_factory: pytest.TempPathFactory) -> Iterator[RealService]:
    folder = tmp_path_factory.mktemp("real")
    catalog = Catalog(Store.open(str(folder / "store")))
    for map_id in ("one", "other"):
        catalog.publish(map_id, small_version.directory, Manifest.for_directory(small_version.directory))
    port, held = free_port(), folder / "held"
    environment = environment_of(folder, port=port, queue_size=0)
    path = os.pathsep.join([str(HELD_SEARCH), *filter(None, [os.environ.get("PYTHONPATH")])])
    environment.update({"PYTHONPATH": path, "HELD_SEARCHES": str(held)})
    log = folder / "service.log"
    with running([sys.executable, "-c", SERVE], port, log, environment):
        url = f"http://127.0.0.1:{port}"
        wait_until(lambda: httpx.get(f"{url}/readyz", timeout=LIMIT_S).json().get("maps") == 2)
        yield RealService(url, held, log)


@pytest.mark.parametrize("maps", ["one", "one,other"])
@pytest.mark.parametrize("goes", ["closes", "resets"])
def test_the_worker_process_is_free_when_the_caller_has_gone(
    real: RealService, small_scans, maps: str, goes: str
):
    body = encode_scan(small_scans[0][0])
    before, begun = real.value("firstfix_localize_failures_total", **GONE), len(real.searches)
    lines = len(real.lines_of_gone)
    with real.connect() as connection:
        connection.sendall(request(f"/localize?map={maps}&max_candidates=77", body, MEDIA_TYPE))
        wait_until(lambda: len(real.searches) > begun)
        if goes == "resets":
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")
    assert int(real.searches[-1]) == maps.count(",") + 1
    wait_until(lambda: real.value("firstfix_queries_admitted") == 0)
    counted = real.value("firstfix_localize_failures_total", **GONE)
    assert counted == (1 if math.isnan(before) else before + 1)
    wait_until(lambda: len(real.lines_of_gone) == lines + 1)
    assert real.lines_of_gone[-1]["code"] == "client_gone"
    answer = httpx.post(
        f"{real.url}/localize?map=one", content=body, headers={"Content-Type": MEDIA_TYPE}, timeout=LIMIT_S
    )
    assert answer.status_code == 200, "there is no queue: its worker is free"
    assert len(real.searches) == begun + 1
