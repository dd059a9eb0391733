"""Loads for queries: callers take turns, and share the loads of what both need."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from pathlib import Path

import pytest

from firstfix.errors import NotFound
from firstfix_service.maps.loaded_versions import Lease
from firstfix_service.maps.version_loader import LOADERS, SharedLoads
from firstfix_service.query_workers.query import ServedVersion
from firstfix_service.telemetry.request_scope import Requests, note
from tests.waiting import LIMIT_S, wait_until


class Loads:
    """Loads that wait for a gate."""

    def __init__(self) -> None:
        self.begun: list[str] = []
        self.gate = threading.Event()
        self.shared = SharedLoads(self._load)

    def request(self, caller: str, map_id: str) -> Future[Lease]:
        with Requests().scope("http", None, request_id="", traceparent=None, started=time.monotonic()):
            note(caller=caller)
            return self.shared.request(map_id, None)

    def _load(self, map_id: str, version: str | None) -> Lease:
        self.begun.append(map_id)
        assert self.gate.wait(LIMIT_S)
        if map_id == "missing":
            raise NotFound("no such map")
        return _lease(map_id)


def _lease(map_id: str) -> Lease:
    return Lease(ServedVersion(map_id, "v", Path()), lambda: None, lambda: _lease(map_id))


@pytest.fixture
def loads() -> Iterator[Loads]:
    with _closed(Loads()) as these:
        yield these


@contextmanager
def _closed(loads: Loads) -> Iterator[Loads]:
    try:
        yield loads
    finally:
        loads.gate.set()
        loads.shared.close()


def test_many_cold_maps_of_one_caller_do_not_hold_up_another(loads: Loads):
    many = [loads.request("flood", f"cold-{number}") for number in range(30)]
    wait_until(lambda: len(loads.begun) == LOADERS - 1)
    one = loads.request("robot", "hall")
    wait_until(lambda: "hall" in loads.begun)
    loads.gate.set()
    assert [future.result(LIMIT_S).served.map_id for future in (*many, one)][-1] == "hall"
    assert sorted(loads.begun) == sorted({*loads.begun}), "each is loaded once"


def test_a_load_that_waits_in_anothers_line_begins_in_the_turn_of_whoever_is_first(loads: Loads):
    many = [loads.request("flood", f"cold-{number}") for number in range(30)]
    wait_until(lambda: len(loads.begun) == LOADERS - 1)
    same = loads.request("robot", "cold-29")
    wait_until(lambda: "cold-29" in loads.begun)
    loads.gate.set()
    for future in (*many, same):
        future.result(LIMIT_S)
    assert loads.begun.count("cold-29") == 1


def test_an_error_is_everybodys_who_asked_and_the_next_request_tries_again(loads: Loads):
    asked = [loads.request(caller, "missing") for caller in ("a", "b", "a")]
    loads.gate.set()
    for future in asked:
        with pytest.raises(NotFound):
            future.result(LIMIT_S)
    with pytest.raises(NotFound):
        loads.request("a", "missing").result(LIMIT_S)
    assert loads.begun == ["missing", "missing"]


def test_the_end_waits_for_loads_that_have_begun_alone():
    with _closed(Loads()) as loads:
        many = [loads.request("flood", f"cold-{number}") for number in range(30)]
        wait_until(lambda: len(loads.begun) == LOADERS - 1)
        threading.Timer(0.05, loads.gate.set).start()
        loads.shared.close()
        assert sum(future.done() for future in many) == LOADERS - 1 == len(loads.begun)
