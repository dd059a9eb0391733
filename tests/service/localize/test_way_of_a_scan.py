"""The way of a scan: the files that are drawn, and each check once. A worker only decodes the body."""

from __future__ import annotations

import os
import re
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import count
from pathlib import Path

import httpx
import pytest
import zenoh

from firstfix.catalog.catalog import Catalog
from firstfix.catalog.manifest import Manifest
from firstfix.store.store import Store
from firstfix.wire.scan import MEDIA_TYPE, encode_scan
from firstfix_service.telemetry.late_counts import TOGETHER
from tests.servers import running
from tests.service.service_world import client_session, free_port
from tests.waiting import LIMIT_S, wait_until

CALL_LOG = Path(__file__).with_name("call_log")
NUMBERS = count()
SERVE = """
from firstfix_service.server import serve
from firstfix_service.settings import Settings
serve(Settings())
"""
PAGE = Path(__file__).parents[3] / "docs/concepts/way-of-a-scan.md"
ROOMS = {"limits", "localize", "maps", "query_workers", "telemetry"}
BESIDE = {"telemetry/stall_watch.py"}  # runs on the event loop whether or not there are queries
NOT_HERE = {"limits/turns.py", "limits/rate.py"}  # for refusals, and where other machines reach the service
ONCE = {
    "read query",
    "check scope",
    "take from rate limit",
    "check map id",
    "check map of caller",
    "parse options",
    "check version",
    "look up media type",
    "look up content encoding",
    "check room",
}


@dataclass
class LoggedService:
    """A service process that logs its calls.

    Attributes:
        version: of the map "yard".
    """

    url: str
    endpoint: str
    version: str
    body: bytes
    pid: int
    log: Path

    def ask_http(self) -> bytes:
        parameters = {"map": "yard", "version": self.version, "deadline_ms": "600000"}
        headers = {"Content-Type": f"{MEDIA_TYPE}; number={next(NUMBERS)}"}  # none that was looked up before
        answer = httpx.post(
            f"{self.url}/localize", params=parameters, content=self.body, headers=headers, timeout=LIMIT_S
        )
        assert answer.status_code == 200, answer.text
        return answer.content

    def ask_zenoh(self) -> bytes:
        selector = zenoh.Selector(
            "firstfix/yard/localize", {"version": self.version, "deadline_ms": "600000"}
        )
        session = client_session(self.endpoint)
        try:
            encoding = f"{MEDIA_TYPE};number={next(NUMBERS)}"
            (reply,) = session.get(selector, payload=self.body, encoding=encoding, timeout=LIMIT_S)
            assert reply.ok is not None, reply.err.payload.to_bytes()
            return reply.ok.payload.to_bytes()
        finally:
            session.close()

    def calls_of(self, ask: Callable[[], object]) -> Counter[tuple[str, int]]:
        """Function and process id of the calls that were made while the query ran."""
        before = self.log.stat().st_size
        ask()
        lines = self.log.read_bytes()[before:].decode().splitlines()
        return Counter((name, int(pid)) for name, pid in (line.split(",") for line in lines))


@pytest.fixture(scope="module")
def logged(small_version, small_scans, tmp_path_factory: pytest.TempPathFactory) -> Iterator[LoggedService]:
    folder = tmp_path_factory.mktemp("logged")
    catalog = Catalog(Store.open(str(folder / "store")))
    manifest = Manifest.for_directory(small_version.directory)
    version = catalog.publish("yard", small_version.directory, manifest)
    port, endpoint, log = free_port(), f"tcp/127.0.0.1:{free_port()}", folder / "calls.log"
    environment = {
        "PYTHONPATH": os.pathsep.join([str(CALL_LOG), *filter(None, [os.environ.get("PYTHONPATH")])]),
        "CALL_LOG": str(log),
        "FIRSTFIX_STORE": str(folder / "store"),
        "FIRSTFIX_PORT": str(port),
        "FIRSTFIX_CACHE_DIR": str(folder / "cache"),
        "FIRSTFIX_WORK_DIR": str(folder / "work"),
        "FIRSTFIX_RUN_BUILDS": "false",
        "FIRSTFIX_READ_ONLY": "true",
        "FIRSTFIX_POLL_INTERVAL_S": "3600",  # so that all calls are those of queries
        "FIRSTFIX_WORKERS": "1",
        "FIRSTFIX_ZENOH": "true",
        "FIRSTFIX_ZENOH_LISTEN": f'["{endpoint}"]',
    }
    with running([sys.executable, "-c", SERVE], port, folder / "service.log", environment) as process:
        url = f"http://127.0.0.1:{port}"
        wait_until(lambda: httpx.get(f"{url}/readyz", timeout=LIMIT_S).status_code == 200)
        service = LoggedService(url, endpoint, version, encode_scan(small_scans[0][0]), process.pid, log)
        service.ask_http()  # loads the version
        yield service


@pytest.mark.parametrize("transport", ["http", "zenoh"])
def test_each_check_of_a_scan_is_made_once(logged: LoggedService, transport: str):
    calls = logged.calls_of({"http": logged.ask_http, "zenoh": logged.ask_zenoh}[transport])
    checks = {key: count for key, count in calls.items() if not key[0].startswith("file ")}
    in_service = {name: count for (name, pid), count in checks.items() if pid == logged.pid}
    elsewhere = {name: count for (name, pid), count in checks.items() if pid != logged.pid}
    assert in_service == dict.fromkeys(ONCE, 1)
    assert elsewhere == {"decode body": 1}


def test_a_scan_goes_through_the_files_that_are_drawn(logged: LoggedService):
    calls: Counter[tuple[str, int]] = Counter()
    for _ in range(TOGETHER):  # with the end of each, which is after its answer, and the counts of several
        calls += logged.calls_of(logged.ask_http)
    used = {name.removeprefix("file firstfix_service/") for name, _ in calls if "firstfix_service/" in name}
    drawn = [f"{name}.py" for name in re.findall(r"^ │ (\w+/[\w/]+) ", PAGE.read_text(), re.MULTILINE)]
    assert {name for name in used - BESIDE if name.split("/")[0] in ROOMS} == {
        name for name in drawn if name.split("/")[0] in ROOMS and name not in NOT_HERE
    }
