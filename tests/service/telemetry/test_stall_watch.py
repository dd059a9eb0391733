"""The watchdog: parts that stand still are seen, logged once, and end the process."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import pytest
from prometheus_client import CollectorRegistry

from firstfix_service.telemetry import stall_watch
from firstfix_service.telemetry.histogram import Histogram
from firstfix_service.telemetry.stall_watch import (
    EXIT_STALLED,
    MAX_STACKS_CHARS,
    Pulse,
    StallWatch,
    stacks_of_all_threads,
)
from tests.servers import free_port
from tests.service.service_world import environment_of, is_ready
from tests.waiting import LIMIT_S, let_pass, wait_until

STALLING_SERVICE = Path(__file__).parents[1] / "stalling_process.py"


def lag() -> Histogram:
    return Histogram("lag", "Lag", buckets=(0.1, 2.5, 10.0), registry=CollectorRegistry())


@contextmanager
def running_loop() -> Iterator[asyncio.AbstractEventLoop]:
    loop = asyncio.new_event_loop()
    thread = threading.Thread(target=loop.run_forever)
    thread.start()
    try:
        yield loop
    finally:
        loop.call_soon_threadsafe(loop.stop)
        thread.join()
        loop.close()


def test_a_stall_is_logged_once_and_unhealthy_after_five_seconds():
    pulse = Pulse("zenoh")
    assert not pulse.pass_time(100), "nothing is under way"
    with pulse.call():
        assert not pulse.pass_time(0.9)
        assert pulse.pass_time(0.2)
        assert not pulse.pass_time(0.2)
        assert pulse.why_unwell() is None
        pulse.pass_time(4)
        assert pulse.why_unwell() == "zenoh has not come back for 5 s"
    assert pulse.why_unwell() == "zenoh stood still for 5 s, 0 s ago"


def test_a_stall_below_five_seconds_is_healthy():
    pulse = Pulse("zenoh")
    with pulse.call():
        pulse.pass_time(4.9)
    assert pulse.why_unwell() is None


def test_a_stalled_loop_is_named():
    stalled: list[str] = []
    told, go_on = threading.Event(), threading.Event()

    def on_stall(pulse: Pulse) -> None:
        stalled.append(pulse.name)
        told.set()

    watch = StallWatch(lag(), 0.5)
    watch.on_stall = on_stall
    with running_loop() as loop:
        watch.start(loop)
        loop.call_soon_threadsafe(go_on.wait)
        assert told.wait(LIMIT_S)
        go_on.set()
        watch.close()
    assert stalled == ["the event loop"]


def test_a_limit_of_zero_ends_no_process():
    seconds = lag()
    watch = StallWatch(seconds, 0.0)
    watch.on_stall = pytest.fail
    go_on = threading.Event()
    with running_loop() as loop:
        watch.start(loop)
        loop.call_soon_threadsafe(go_on.wait)
        wait_until(lambda: watch.why_unwell() is not None)
        assert watch.why_unwell().startswith("the event loop has not come back for")
        go_on.set()
        wait_until(lambda: "stood still" in (watch.why_unwell() or ""))
        watch.close()
    below = {s.labels["le"]: s.value for s in next(seconds.collect()).samples if s.name == "lag_bucket"}
    assert below["+Inf"] > below["2.5"], "the lag is in the histogram"


def test_time_in_which_the_process_did_not_run_does_not_count(monkeypatch: pytest.MonkeyPatch):
    """The clock jumps by an hour and no processor time was used: the machine slept."""
    now = 0.0

    class Clock:
        @staticmethod
        def monotonic() -> float:
            return now

        @staticmethod
        def process_time() -> float:
            return 0.0

    watch = StallWatch(lag(), 20.0)
    watch.on_stall = pytest.fail
    part = watch.add("zenoh")
    part.begin()
    monkeypatch.setattr(stall_watch, "time", Clock)
    with running_loop() as loop:
        watch.start(loop)
        let_pass(0.5)
        now = 3600.0
        let_pass(0.5)
        watch.close()
    assert part.stalled_s < 1.0


def test_stacks_name_threads_and_places_but_no_values():
    secret = "ffx_hidden"
    go_on = threading.Event()
    threads = [threading.Thread(target=go_on.wait, name=f"waits-{k}") for k in range(3)]
    for thread in threads:
        thread.start()
    text = stacks_of_all_threads()
    go_on.set()
    for thread in threads:
        thread.join()
    assert "waits-0, waits-1, waits-2:" in text, "threads at one place share a stack"
    assert "test_stacks_name_threads" in text
    assert secret not in text
    assert len(text) <= MAX_STACKS_CHARS + 10


@dataclass
class StallingService:
    """A service in a process of its own, whose loop a request to /stall/{seconds} blocks."""

    process: subprocess.Popen[bytes]
    http: httpx.Client
    log_path: Path

    def lines(self, event: str) -> list[dict[str, Any]]:
        lines = [json.loads(line) for line in self.log_path.read_text().splitlines() if line[:1] == "{"]
        return [line for line in lines if line.get("event") == event]

    def stall(self, seconds: float) -> threading.Thread:
        def ask() -> None:
            with suppress(httpx.TransportError):  # the process ended
                self.http.get(f"/stall/{seconds}")

        thread = threading.Thread(target=ask)
        thread.start()
        return thread

    @property
    def is_ready(self) -> bool:
        return is_ready(str(self.http.base_url))


@contextmanager
def stalling_service(folder: Path, **settings: str) -> Iterator[StallingService]:
    port, log_path = free_port(), folder / "log"
    environment = {**environment_of(folder, port=port), **settings}
    with log_path.open("wb") as log:
        command = [sys.executable, str(STALLING_SERVICE)]
        process = subprocess.Popen(command, env=environment, stdout=log, stderr=log)
    try:
        with httpx.Client(base_url=f"http://127.0.0.1:{port}", timeout=LIMIT_S) as http:
            service = StallingService(process, http, log_path)
            wait_until(lambda: service.is_ready or process.poll() is not None)
            assert process.poll() is None, log_path.read_text()[-2000:]
            yield service
    finally:
        process.send_signal(signal.SIGCONT)
        process.kill()
        process.wait()


def children(pid: int) -> list[int]:
    """Returns the children of all its threads."""
    lists = [path.read_text() for path in Path(f"/proc/{pid}/task").glob("*/children")]
    return [int(one) for text in lists for one in text.split()]


@pytest.mark.slow
def test_a_stalled_service_ends_with_its_children(tmp_path: Path):
    with stalling_service(tmp_path, FIRSTFIX_STALLED_EXIT_S="3") as service:
        workers = children(service.process.pid)
        assert workers
        asking = service.stall(10 * LIMIT_S)
        assert service.process.wait(LIMIT_S) == EXIT_STALLED
        asking.join()
        told = service.lines("a part stands still")
        assert [line["part"] for line in told] == ["the event loop"] * len(told)
        assert "MainThread" in told[-1]["stacks"]
        (ended,) = service.lines("ends the process: a part stands still")
        assert ended["exit_code"] == EXIT_STALLED
        assert "stalling_process.py" in ended["stacks"]
        for worker in workers:
            wait_until(lambda pid=worker: not Path(f"/proc/{pid}/cmdline").exists())


@pytest.mark.slow
def test_a_service_goes_on_after_a_short_stall(tmp_path: Path):
    with stalling_service(tmp_path, FIRSTFIX_STALLED_EXIT_S="200") as service:
        service.stall(6).join()
        wait_until(lambda: service.lines("a part goes on"))
        assert service.lines("a part stands still")
        health = service.http.get("/healthz")
        assert health.status_code == 503
        assert "the event loop stood still" in health.json()["detail"]
        assert service.http.get("/readyz").status_code == 503
        wait_until(lambda: service.http.get("/healthz").is_success)
        assert service.is_ready
        lines = [line.split() for line in service.http.get("/metrics").text.splitlines()]
        counts = {line[0]: float(line[1]) for line in lines if "event_loop_lag_seconds_" in line[0]}
        slow = counts['firstfix_event_loop_lag_seconds_bucket{le="3.0"}']
        assert counts["firstfix_event_loop_lag_seconds_count"] > slow


@pytest.mark.slow
def test_a_stopped_process_is_not_stalled(tmp_path: Path):
    with stalling_service(tmp_path, FIRSTFIX_STALLED_EXIT_S="2") as service:
        service.process.send_signal(signal.SIGSTOP)
        let_pass(6)
        service.process.send_signal(signal.SIGCONT)
        wait_until(lambda: service.is_ready)
        let_pass(3)
        assert service.is_ready
        assert service.lines("a part stands still") == []


@pytest.mark.slow
def test_a_frozen_reader_of_the_log_delays_no_request(tmp_path: Path):
    """The log goes into a pipe that nobody reads: it is full after 64 kB."""
    port, (frozen, log) = free_port(), os.pipe()
    command = [sys.executable, str(STALLING_SERVICE)]
    process = subprocess.Popen(command, env=environment_of(tmp_path, port=port), stderr=log)
    os.close(log)
    try:
        with httpx.Client(base_url=f"http://127.0.0.1:{port}", timeout=LIMIT_S) as http:
            service = StallingService(process, http, tmp_path / "log")
            wait_until(lambda: service.is_ready or process.poll() is not None)
            for _ in range(200):
                assert http.get(f"/maps/{'m' * 60}/{'x' * 400}").status_code == 404
            assert service.is_ready
        process.send_signal(signal.SIGTERM)
        assert process.wait(LIMIT_S) == -signal.SIGTERM
    finally:
        process.kill()
        process.wait()
        os.close(frozen)
