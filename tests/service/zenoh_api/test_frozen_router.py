"""A router that neither goes on nor goes away, beside robots that are connected to the service itself."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from firstfix.answer.localization import Verdict
from firstfix.scan.scan import Scan
from firstfix_client import ZenohClient
from tests.servers import free_port, running
from tests.service.service_world import Service, publish, running_service
from tests.waiting import LIMIT_S, wait_until

pytestmark = pytest.mark.slow

NEVER_MS = 3_600_000  # time after which zenoh gives up a silent connection; by default 10 s
_ROUTER = "import sys, time, zenoh; s = zenoh.open(zenoh.Config.from_file(sys.argv[1])); time.sleep(3600)"


def config(path: Path, mode: str, **changes: object) -> Path:
    common = {
        "mode": mode,
        "scouting": {"multicast": {"enabled": False}},
        "transport": {"link": {"tx": {"lease": NEVER_MS}}},
    }
    path.write_text(json.dumps({**common, **changes}))
    return path


@pytest.fixture
def router(tmp_path: Path) -> Iterator[tuple[str, subprocess.Popen[bytes]]]:
    port = free_port()
    endpoint = f"tcp/127.0.0.1:{port}"
    file = config(tmp_path / "router.json5", "router", listen={"endpoints": [endpoint]})
    with running([sys.executable, "-c", _ROUTER, str(file)], port, tmp_path / "router.log") as process:
        yield endpoint, process


@pytest.fixture
def service(tmp_path: Path, router: tuple[str, subprocess.Popen[bytes]]) -> Iterator[Service]:
    own = f"tcp/127.0.0.1:{free_port()}"
    listen, connect = {"endpoints": [own]}, {"endpoints": [router[0]]}
    file = config(tmp_path / "service.json5", "peer", listen=listen, connect=connect)
    with running_service(tmp_path, zenoh_config=file, zenoh_listen=(own,)) as running_one:
        publish(running_one.catalog, "hall", "1", running_one.scratch)
        yield running_one


def test_a_robot_beside_it_is_answered(service: Service, router: tuple[str, subprocess.Popen[bytes]]):
    scan = Scan.from_points(np.random.default_rng(1).uniform(-9, 9, (300, 3)))
    with (
        ZenohClient(service.endpoint, timeout_s=2 * LIMIT_S) as client,
        ThreadPoolExecutor(1) as thread,
    ):
        wait_until(lambda: "firstfix_zenoh_connections 3.0" in service.http.get("/metrics").text)
        assert client.localize(scan, map_id="hall").verdict is Verdict.LOCALIZED
        router[1].send_signal(signal.SIGSTOP)
        try:
            # zenoh asks the router too, and the query ends when that has answered, or at its deadline.
            asked = thread.submit(client.localize, scan, map_id="hall")
            assert asked.result(LIMIT_S).verdict is Verdict.LOCALIZED
        finally:
            router[1].send_signal(signal.SIGCONT)
