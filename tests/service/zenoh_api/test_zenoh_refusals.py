"""Refusals over zenoh come late beyond the credit of who asks, which is that of HTTP."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from firstfix_service.limits.limits import Limits
from firstfix_service.zenoh_api import refusals
from tests.service.access_world import ask_zenoh, get, known
from tests.service.service_world import SCAN_BODY, Service, publish, running_service
from tests.waiting import wait_until

WORKERS, QUEUE = 1, 1
PLACES = 8 * (WORKERS + QUEUE)  # of all zenoh queries
LIMIT_BYTES = 50 * len(SCAN_BODY)


@pytest.fixture
def slow(tmp_path: Path) -> Iterator[Service]:
    """A service that refuses everybody once at once, and then as good as never."""
    with running_service(
        tmp_path,
        auth="on",
        keys_refresh_s=0.1,
        requests_per_s=1e-3,
        workers=WORKERS,
        queue_size=QUEUE,
        max_inflight_bytes=LIMIT_BYTES,
    ) as service:
        publish(service.catalog, "hall", "1", service.scratch)
        wait_until(lambda: service.http.get("/readyz").json().get("maps") == 1)
        yield service


@pytest.fixture
def held(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Records for how many seconds refusals should wait, and lets them go at once."""
    seen: list[float] = []

    async def sleep(seconds: float) -> None:
        seen.append(seconds)

    monkeypatch.setattr(refusals, "sleep", sleep)
    return seen


@dataclass
class Waiting:
    """Refusals that wait until they are let go."""

    count: int = 0
    let_go: threading.Event = field(default_factory=threading.Event)

    async def sleep(self, seconds: float) -> None:
        self.count += 1
        while not self.let_go.is_set():
            await asyncio.sleep(0.01)


@pytest.fixture
def waiting(slow: Service, monkeypatch: pytest.MonkeyPatch) -> Iterator[Waiting]:
    made = Waiting()
    monkeypatch.setattr(refusals, "sleep", made.sleep)
    yield made
    made.let_go.set()


def code_of(service: Service, key: str | None, map_id: str = "hall") -> str:
    """The code of an error; empty: an answer."""
    reply = ask_zenoh(service, key, map_id)
    return "" if reply.ok else str(reply.json["code"])


def test_refusals_wait_after_the_burst_and_answers_do_not(slow: Service, held):
    robot, other = known(slow, "localize"), known(slow, "localize")
    assert code_of(slow, robot, "none") == "not_found"
    assert not held, "within its credit"
    assert code_of(slow, robot, "none") == "not_found"
    assert held == [Limits.max_wait_s]
    assert code_of(slow, robot) == ""
    assert len(held) == 1, "a queue has given it its turn"
    assert code_of(slow, other, "none") == "not_found"
    assert len(held) == 1, "another caller"


def test_each_kind_of_refusal_counts(slow: Service, held):
    robot, reader, elsewhere = (
        known(slow, "localize"),
        known(slow, "metrics"),
        known(slow, "localize", maps=("yard",)),
    )
    for key in (robot, reader, elsewhere):
        code_of(slow, key, "none")
    held.clear()
    assert code_of(slow, reader) == code_of(slow, elsewhere) == "forbidden"
    assert code_of(slow, robot, "none") == "not_found"
    assert held == [Limits.max_wait_s] * 3


def test_the_credit_is_that_of_http(slow: Service, held):
    robot = known(slow, "localize")
    assert get(slow, "/maps", robot).is_success
    code_of(slow, robot, "none")
    assert held == [Limits.max_wait_s]


def test_strangers_count_together(slow: Service, held):
    assert code_of(slow, None) == "unauthorized"
    assert not held
    assert code_of(slow, "wrong") == "unauthorized"
    assert held == [Limits.max_unauthenticated_wait_s]
    assert code_of(slow, known(slow, "localize")) == ""


def test_waiting_refusals_take_no_places_and_bounded_memory(slow: Service, waiting):
    robot, other = known(slow, "localize"), known(slow, "localize")
    code_of(slow, robot, "none")
    most = LIMIT_BYTES // 2 // len(SCAN_BODY)
    assert most > PLACES
    with ThreadPoolExecutor(most) as threads:
        flood = []
        for number in range(most):
            flood.append(threads.submit(code_of, slow, robot, "none"))
            wait_until(lambda number=number: waiting.count == number + 1)
        assert code_of(slow, other) == ""
        assert code_of(slow, robot, "none") == "overloaded", "at once: there is no room for its body"
        assert not any(one.done() for one in flood)
        waiting.let_go.set()
        assert {one.result() for one in flood} == {"not_found"}


def test_only_some_refusals_of_a_flooding_caller_wait(
    slow: Service, waiting, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(Limits, "max_waiting_refusals", 3)
    robot = known(slow, "localize")
    code_of(slow, robot, "none")
    with ThreadPoolExecutor(3) as threads:
        late = [threads.submit(code_of, slow, robot, "none") for _ in range(3)]
        wait_until(lambda: waiting.count == 3)
        assert code_of(slow, robot, "none") == "not_found"
        assert not any(one.done() for one in late)
        waiting.let_go.set()
