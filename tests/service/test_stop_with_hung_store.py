"""A service that is told to stop while its object store accepts requests and answers none."""

from __future__ import annotations

import os
import re
import secrets
import signal
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import httpx
import pytest

from firstfix.catalog.catalog import Catalog
from firstfix.store.store import Store
from tests.servers import free_port, running_versitygw
from tests.service.service_world import publish
from tests.waiting import LIMIT_S, wait_until

pytestmark = pytest.mark.slow

REPLICA = Path(__file__).with_name("replica_process.py")
BUCKET = "maps"
REQUESTS = 6


@dataclass
class World:
    """A store on a server of its own, which can be stopped."""

    url: str
    server: subprocess.Popen[bytes]


@pytest.fixture
def store(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[World]:
    folder = tmp_path / "s3"
    (folder / "data" / BUCKET).mkdir(parents=True)
    port, access, secret = free_port(), secrets.token_hex(8), secrets.token_hex(16)
    monkeypatch.setenv("AWS_ACCESS_KEY_ID", access)
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", secret)
    with running_versitygw(folder, port, access, secret) as server:
        at = f"http://127.0.0.1:{port}"
        yield World(f"s3://{BUCKET}/store?endpoint={at}&region=us-east-1&allow_http=true", server)


def test_requests_that_wait_for_the_store_are_told_and_the_process_ends(store: World, tmp_path: Path):
    version = publish(Catalog(Store.open(store.url)), "hall", "1", tmp_path / "made")
    url = f"http://127.0.0.1:{(port := free_port())}"
    settings = {
        "FIRSTFIX_STORE": store.url,
        "FIRSTFIX_WORK_DIR": str(tmp_path / "work"),
        "FIRSTFIX_CACHE_DIR": str(tmp_path / "cache"),
        "FIRSTFIX_PORT": str(port),
        "FIRSTFIX_RUN_BUILDS": "true",
        "FIRSTFIX_POLL_INTERVAL_S": "0.1",
    }
    with (tmp_path / "log").open("wb") as log:
        service = subprocess.Popen(
            [sys.executable, str(REPLICA)], env={**os.environ, **settings}, stdout=log, stderr=log
        )
    try:
        wait_until(lambda: is_ready(url))
        store.server.send_signal(signal.SIGSTOP)
        activate = f"{url}/maps/hall/versions/{version}/activate"
        with ThreadPoolExecutor(REQUESTS) as threads:
            asked = [threads.submit(httpx.get, f"{url}/maps", timeout=LIMIT_S) for _ in range(REQUESTS - 1)]
            asked.append(threads.submit(httpx.post, activate, timeout=LIMIT_S))
            wait_until(lambda: connections(url) == REQUESTS + 1)
            service.send_signal(signal.SIGTERM)
            answers = [one.result() for one in asked]
        # By itself the store's client gives up after 20 seconds and more: then it is "store_unavailable".
        assert [answer.status_code for answer in answers] == [503] * REQUESTS
        assert {answer.json()["code"] for answer in answers} == {"overloaded"}
        assert {answer.json()["detail"] for answer in answers} == {"the service is stopping"}
        assert service.wait(LIMIT_S) == -signal.SIGTERM, (tmp_path / "log").read_text()[-2000:]
        assert store.server.poll() is None, "the store still hangs"
    finally:
        service.kill()
        service.wait()


def is_ready(url: str) -> bool:
    try:
        return httpx.get(f"{url}/readyz").is_success
    except httpx.TransportError:
        return False


def connections(url: str) -> int:
    text = httpx.get(f"{url}/metrics").text
    return int(float(re.findall(r"^firstfix_http_connections (\S+)", text, re.MULTILINE)[0]))
