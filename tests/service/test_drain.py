"""Drain: a service that stops is first not ready, and answers until proxies have seen it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import httpx

from tests.servers import free_port
from tests.waiting import LIMIT_S, wait_until


def test_it_is_not_ready_any_more_before_it_stops(tmp_path: Path):
    port = free_port()
    settings = {
        "FIRSTFIX_STORE": str(tmp_path / "store"),
        "FIRSTFIX_WORK_DIR": str(tmp_path / "work"),
        "FIRSTFIX_CACHE_DIR": str(tmp_path / "cache"),
        "FIRSTFIX_PORT": str(port),
        "FIRSTFIX_RUN_BUILDS": "false",
        "FIRSTFIX_WORKERS": "1",
        "FIRSTFIX_DRAIN_S": "4",
    }
    command = [sys.executable, "-m", "firstfix_cli.main", "serve"]
    with (tmp_path / "log").open("wb") as log:
        service = subprocess.Popen(command, env={**os.environ, **settings}, stdout=log, stderr=log)
    url = f"http://127.0.0.1:{port}"
    try:
        with httpx.Client() as calls:
            wait_until(lambda: is_ready(calls, url) is True)
            service.send_signal(signal.SIGTERM)
            wait_until(lambda: is_ready(calls, url) is False)
        # Requests are still answered, also those of new callers.
        assert "about to stop" in httpx.get(f"{url}/readyz").json()["detail"]
        assert httpx.get(f"{url}/maps").status_code == 200
        assert httpx.get(f"{url}/healthz").status_code == 200
        assert service.wait(LIMIT_S) == -signal.SIGTERM, (tmp_path / "log").read_text()[-2000:]
    finally:
        service.kill()
        service.wait()


def is_ready(calls: httpx.Client, url: str) -> bool | None:
    """Returns None while it does not listen yet."""
    try:
        return calls.get(f"{url}/readyz").is_success
    except httpx.TransportError:
        return None
