"""The version watch with zenoh sessions that send notices late, twice, out of order, or damaged."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from typing import Any

import pytest

from firstfix_client import VersionChange, ZenohClient
from tests.client.zenoh_sessions import opened
from tests.servers import free_port
from tests.waiting import LIMIT_S


class Teller:
    """A router that also answers questions about versions, as a replica does."""

    def __init__(self) -> None:
        self.endpoint = f"tcp/127.0.0.1:{free_port()}"
        self.session = opened("router", "listen", self.endpoint)
        self.known: dict[str, dict[str, Any]] = {}
        self.looks = threading.Semaphore(0)
        self.queryable = self.session.declare_queryable("firstfix/*/version", self._asked, complete=True)

    def _asked(self, query: Any) -> None:
        with query:
            for map_id, told in self.known.items():
                query.reply(f"firstfix/{map_id}/version", json.dumps(told))
        self.looks.release()

    def know(self, seq: int, version: str) -> None:
        """Set its answer from now on, of the map hall alone."""
        self.known = {"hall": {"map_id": "hall", "seq": seq, "version": version}}

    def tell(self, map_id: str, seq: int, version: str | None) -> None:
        self.put(map_id, json.dumps({"map_id": map_id, "seq": seq, "version": version}))

    def put(self, map_id: str, text: str) -> None:
        self.session.put(f"firstfix/{map_id}/version", text)


@pytest.fixture
def teller() -> Iterator[Teller]:
    made = Teller()
    yield made
    made.session.close()


@pytest.fixture
def client(teller: Teller) -> Iterator[ZenohClient]:
    with ZenohClient(teller.endpoint) as connected:
        yield connected


def test_known_versions_come_first_then_changes(teller: Teller, client: ZenohClient):
    teller.know(2, "a")
    with client.watch_versions() as watch:
        assert next(watch) == VersionChange("hall", "a", None)
        teller.tell("hall", 3, "b")
        assert next(watch) == VersionChange("hall", "b", "a")
        teller.tell("hall", 4, None)
        assert next(watch) == VersionChange("hall", None, "b")


TOO_DEEP = "[" * 3000
HUGE = '{"map_id": "hall", "seq": 1e999, "version": "x"}'
ODD = ["-1", "true", "9007199254740992", "1.5", "null", "NaN"]


def test_old_equal_and_invalid_notices_are_ignored(teller: Teller, client: ZenohClient):
    teller.know(5, "a")
    with client.watch_versions() as watch:
        next(watch)
        teller.tell("hall", 5, "a")  # another replica's
        teller.tell("hall", 4, "old")  # one that is late
        teller.tell("hall", 6, "a")  # something else happened to the map
        for nonsense in ("", "[]", "{}", '{"map_id": "hall", "seq": "x", "version": "y"}', TOO_DEEP, HUGE):
            teller.put("hall", nonsense)
        for seq in ODD:
            teller.put("hall", f'{{"map_id": "hall", "seq": {seq}, "version": "x"}}')
        for map_id, version in (("../hall", "x"), ("hall", 7), ("hall", "x" * 65)):
            teller.put("hall", json.dumps({"map_id": map_id, "seq": 9, "version": version}))
        teller.tell("hall", 7, "b")
        assert next(watch) == VersionChange("hall", "b", "a")


def test_a_lost_notice_is_found_by_a_look(teller: Teller, client: ZenohClient):
    with client.watch_versions(look_every_s=0.1) as watch:
        teller.know(2, "a")
        assert next(watch) == VersionChange("hall", "a", None)
        teller.know(3, "b")
        assert next(watch) == VersionChange("hall", "b", "a")


def test_a_slow_reader_gets_the_last_one(teller: Teller, client: ZenohClient):
    teller.know(0, "v0")
    with client.watch_versions(look_every_s=3600) as watch:
        assert next(watch).version == "v0"
        for seq in range(1, 1001):
            teller.tell("hall", seq, f"v{seq}")
        while (change := next(watch)).version != "v1000":
            assert int(str(change.version)[1:]) > int(str(change.previous)[1:])


def test_a_closed_watch_ends(teller: Teller, client: ZenohClient):
    watch = client.watch_versions()
    ended: list[VersionChange] = []
    thread = threading.Thread(target=lambda: ended.extend(watch))
    thread.start()
    assert teller.looks.acquire(timeout=LIMIT_S)
    watch.close()
    watch.close()
    thread.join(LIMIT_S)
    assert not thread.is_alive()
    assert ended == []


def test_an_invalid_answer_does_not_end_a_look(teller: Teller, client: ZenohClient):
    def answer(query: Any) -> None:
        with query:
            for text in (TOO_DEEP, HUGE, '{"map_id": "hall", "seq": 2, "version": "a"}'):
                query.reply("firstfix/hall/version", text)

    teller.queryable.undeclare()
    kept = teller.session.declare_queryable("firstfix/*/version", answer)
    with client.watch_versions(look_every_s=0.05) as watch:
        # zenoh keeps one reply of a key: the last one
        assert next(watch) == VersionChange("hall", "a", None)
    kept.undeclare()


def test_a_false_number_is_corrected_by_a_look(teller: Teller, client: ZenohClient):
    teller.know(2, "a")
    with client.watch_versions(look_every_s=0.05) as watch:
        assert next(watch).version == "a"
        teller.tell("hall", 10**15, "false")
        assert next(watch).version == "false"
        assert next(watch).version == "a", "the replicas have contradicted it"
        teller.tell("hall", 3, "b")
        teller.know(3, "b")
        assert next(watch).version == "b"


def test_a_replica_that_lags_takes_nothing_back(teller: Teller, client: ZenohClient):
    teller.know(2, "a")
    with client.watch_versions(look_every_s=3600) as watch:
        assert next(watch).version == "a"
        teller.tell("hall", 3, "b")
        assert next(watch).version == "b"
        watch._look()  # it still tells the old one
        teller.know(3, "b")
        watch._look()
        teller.tell("hall", 4, "c")
        assert next(watch) == VersionChange("hall", "c", "b")
