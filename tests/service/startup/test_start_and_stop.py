"""A service that starts, stops and goes on beside a store that does not answer, or must not be written."""

from __future__ import annotations

import os
import re
import secrets
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

import httpx
import pytest

from firstfix.catalog.catalog import Catalog
from firstfix.catalog.manifest import Manifest
from firstfix.errors import InvalidOption, StoreUnavailable, StoreUnsafe
from firstfix.store.store import Store
from firstfix_service.startup import retry as start
from tests.servers import free_port, running, running_versitygw
from tests.service.service_world import Service, environment_of, is_ready, publish, running_service
from tests.toxiproxy import Link
from tests.waiting import LIMIT_S, let_pass, wait_until


def test_a_stopping_service_is_not_ready_and_answers_until_it_has_drained(tmp_path: Path):
    port, log = free_port(), tmp_path / "log"
    url, command = f"http://127.0.0.1:{port}", [sys.executable, "-m", "firstfix_cli.main", "serve"]
    with running(command, port, log, environment_of(tmp_path, port=port, drain_s=4)) as process:
        with httpx.Client() as calls:
            wait_until(lambda: calls.get(f"{url}/readyz").is_success)
            process.send_signal(signal.SIGTERM)
            wait_until(lambda: not calls.get(f"{url}/readyz").is_success)
        # Requests are still answered, also those of new callers.
        assert "about to stop" in httpx.get(f"{url}/readyz").json()["detail"]
        assert httpx.get(f"{url}/maps").status_code == 200
        assert httpx.get(f"{url}/healthz").status_code == 200
        assert process.wait(LIMIT_S) == -signal.SIGTERM, log.read_text()[-2000:]


REPLICA = Path(__file__).parents[1] / "replica_process.py"
BUCKET = "maps"
REQUESTS = 6


@contextmanager
def own_store(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[str, subprocess.Popen[bytes]]]:
    """A store on a server of its own, which can be stopped: its URL, and the server."""
    (folder / "data" / BUCKET).mkdir(parents=True)
    port, access, secret = free_port(), secrets.token_hex(8), secrets.token_hex(16)
    monkeypatch.setenv("AWS_ACCESS_KEY_ID", access)
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", secret)
    with running_versitygw(folder, port, access, secret) as server:
        at = f"http://127.0.0.1:{port}"
        yield f"s3://{BUCKET}/store?endpoint={at}&region=us-east-1&allow_http=true", server


@pytest.mark.slow
def test_requests_that_wait_for_the_store_are_refused_at_the_stop(tmp_path, monkeypatch):
    port, log = free_port(), tmp_path / "log"
    url = f"http://127.0.0.1:{port}"
    with own_store(tmp_path / "s3", monkeypatch) as (store, server):
        version = publish(Catalog(Store.open(store)), "hall", "1", tmp_path / "made")
        given = {"store": store, "port": port, "run_builds": "true", "poll_interval_s": 0.1}
        command = [sys.executable, str(REPLICA)]
        with running(command, port, log, environment_of(tmp_path, **given)) as service:
            wait_until(lambda: is_ready(url))
            server.send_signal(signal.SIGSTOP)
            activate = f"{url}/maps/hall/versions/{version}/activate"
            with ThreadPoolExecutor(REQUESTS) as threads:
                asked = [
                    threads.submit(httpx.get, f"{url}/maps", timeout=LIMIT_S) for _ in range(REQUESTS - 1)
                ]
                asked.append(threads.submit(httpx.post, activate, timeout=LIMIT_S))
                wait_until(lambda: connections(url) == REQUESTS + 1)
                service.send_signal(signal.SIGTERM)
                answers = [one.result() for one in asked]
            # By itself the store's client gives up after 20 seconds and more: then it is "store_unavailable".
            assert [answer.status_code for answer in answers] == [503] * REQUESTS
            assert {answer.json()["code"] for answer in answers} == {"overloaded"}
            assert {answer.json()["detail"] for answer in answers} == {"the service is stopping"}
            assert service.wait(LIMIT_S) == -signal.SIGTERM, log.read_text()[-2000:]
            assert server.poll() is None, "the store still hangs"


def connections(url: str) -> int:
    text = httpx.get(f"{url}/metrics").text
    return int(float(re.findall(r"^firstfix_http_connections (\S+)", text, re.MULTILINE)[0]))


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(start, "FIRST_WAIT_S", 0.05)
    monkeypatch.setattr(start, "FIRST_TRY_S", 0.3)


@pytest.mark.slow
@pytest.mark.usefixtures("quick")
def test_a_store_that_is_cut_off_is_waited_for(broken_s3, tmp_path: Path):
    url, link = broken_s3
    link.cut()
    with running_service(tmp_path, store=url, zenoh=False) as service:
        assert service.http.get("/healthz").is_success
        assert "firstfix_http_requests" in service.http.get("/metrics").text
        for method, path in (("GET", "/readyz"), ("GET", "/maps"), ("POST", "/localize"), ("POST", "/maps")):
            response = service.http.request(method, path)
            assert (response.status_code, response.json()["code"]) == (503, "store_unavailable")
            assert "retry-after" in response.headers
        link.mend()
        wait_until(lambda: service.http.get("/readyz").is_success)
        assert service.http.get("/maps").json() == {"maps": [], "next": None}


@pytest.mark.slow
@pytest.mark.usefixtures("quick")
def test_a_store_that_hangs_does_not_keep_the_process_from_listening(broken_s3, tmp_path: Path):
    url, link = broken_s3
    link.poison("timeout", timeout=0)  # data is taken and never answered
    with running_service(tmp_path, store=url, zenoh=False) as service:
        assert service.http.get("/healthz").is_success
        assert service.http.get("/readyz").json()["detail"] == "the object store has not answered yet"
        link.mend()
        wait_until(lambda: service.http.get("/readyz").is_success)


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize(
    ("errors", "seen", "is_mended"),
    [
        ([StoreUnavailable("gone"), *[StoreUnsafe("it overwrites")] * 3], "store_unsafe", True),
        ([StoreUnavailable("gone"), InvalidOption("no such thing")], "invalid_option", False),
    ],
    ids=["tried again", "kept"],
)
def test_errors_of_the_store_are_logged_and_retried_where_waiting_helps(
    tmp_path, monkeypatch, errors, seen, is_mended
):
    left = list(errors)

    def probe(self: Store) -> None:
        if left or not is_mended:
            raise left.pop(0)

    monkeypatch.setattr(Store, "probe", probe)
    codes = set()
    with running_service(tmp_path, zenoh=False) as service:

        def is_settled() -> bool:
            response = service.http.get("/readyz")
            codes.add(response.json().get("code"))
            return response.is_success if is_mended else response.json()["code"] == seen

        wait_until(is_settled)
    assert seen in codes
    assert left == []


def test_a_service_that_still_waits_for_its_store_can_be_stopped(tmp_path, monkeypatch):
    def probe(self: Store) -> None:
        raise StoreUnavailable("gone")

    monkeypatch.setattr(Store, "probe", probe)
    with running_service(tmp_path, zenoh=False) as service:
        assert service.http.get("/readyz").status_code == 503


SOON = {"deadline_ms": "10000"}  # these queries must not wait for the store
FAULTS: dict[str, Callable[[Link], None]] = {
    "cut": Link.cut,
    "hangs": lambda link: link.poison("timeout", timeout=0),
    "latency of 2 s": lambda link: link.poison("latency", latency=2000),
    "10 kB/s": lambda link: link.poison("bandwidth", rate=10),
    "resets": lambda link: link.poison("reset_peer", timeout=50),
    "half answers": lambda link: link.poison("limit_data", bytes=100),
}


def publish_large(catalog: Catalog, label: str, scratch: Path, blob_bytes: int = 300_000) -> str:
    """A version with a large file."""
    folder = scratch / label
    folder.mkdir(parents=True)
    (folder / "label.txt").write_text(label)
    (folder / "blob.bin").write_bytes(os.urandom(blob_bytes))
    return catalog.publish("hall", folder, Manifest.for_directory(folder))


@pytest.mark.slow
@pytest.mark.parametrize("fault", FAULTS)
def test_loaded_versions_answer_through_an_outage(broken_s3, s3_url, tmp_path, fault):
    url, link = broken_s3
    direct = Catalog(Store.open(s3_url))  # other processes reach the store
    publish_large(direct, "1", tmp_path / "made")
    with running_service(tmp_path, store=url) as service:
        wait_until(lambda: service.http.get("/readyz").is_success)
        FAULTS[fault](link)
        second = publish_large(direct, "2", tmp_path / "made", 3_000_000)
        for _ in range(40):  # through several polls
            for transport in ("http", "zenoh"):
                assert service.ask(transport, options=SOON).x == 1
            let_pass(0.1)
        assert service.http.get("/readyz").is_success
        assert not (tmp_path / "cache" / second).exists(), "no half of it is seen"
        link.mend()
        wait_until(lambda: service.ask("http", options=SOON).x == 2)


@pytest.mark.slow
def test_writes_to_an_unreachable_store_are_refused(broken_s3: tuple[str, Link], tmp_path: Path):
    url, link = broken_s3
    with running_service(tmp_path, store=url, zenoh=False) as service:
        wait_until(lambda: service.http.get("/readyz").is_success)
        link.cut()
        assert_unavailable(service, "POST", "/maps")
        assert_unavailable(service, "GET", "/maps")
        assert_unavailable(service, "GET", "/builds/none")
        link.mend()
        form = {"files": {"source": ("map.pcd", b"points")}, "data": {"map_id": "hall"}}
        assert service.http.post("/maps", **form).status_code == 202


def assert_unavailable(service: Service, method: str, path: str) -> None:
    form = {"files": {"source": ("map.pcd", b"points")}, "data": {"map_id": "hall"}}
    response = service.http.request(method, path, **(form if method == "POST" else {}))
    assert (response.status_code, response.json()["code"]) == (503, "store_unavailable")
    assert int(response.headers["retry-after"]) >= 1
