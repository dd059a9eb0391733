"""Answers of one replica come to those who watch another one, and only where strangers cannot read them."""

from __future__ import annotations

import json
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import orjson
import zenoh

from firstfix_service.localize.recent_answers import MAX_ANSWERS
from firstfix_service.zenoh_api.answers import ANSWERS, MAX_BYTES, MAX_RECORDS
from tests.service.access_world import bearer, known
from tests.service.service_world import Service, client_session, publish, running_service, serving
from tests.waiting import LIMIT_S, wait_until

RECORD = {
    "time_s": 1.7e9,
    "caller": "robot",
    "transport": "http",
    "ms": 12.0,
    "answer": {
        "verdict": "rejected",
        "reasons": ["too_few_points"],
        "probability": 0.1,
        "map_id": "hall",
        "map_version": "",
        "T_map_sensor": None,
    },
}


class Watch:
    """The events of one stream of answers."""

    def __init__(self) -> None:
        self.events: list[dict[str, Any]] = []

    @property
    def answers(self) -> list[dict[str, Any]]:
        return [one for one in self.events if "number" in one]

    def of(self, replica: str) -> list[dict[str, Any]]:
        return [one for one in self.answers if one["replica"] == replica]


@contextmanager
def watching(service: Service, headers: dict[str, str] | None = None, **params: Any) -> Iterator[Watch]:
    watch = Watch()
    with service.http.stream(
        "GET", "/answers/events", params=params, headers=headers, timeout=LIMIT_S
    ) as stream:
        assert stream.status_code == 200

        def read() -> None:
            try:
                for line in stream.iter_lines():
                    if line.startswith("data: "):
                        watch.events.append(json.loads(line.removeprefix("data: ")))
            except Exception:
                return  # the test has ended

        threading.Thread(target=read, daemon=True).start()
        wait_until(lambda: bool(watch.events))
        try:
            yield watch
        finally:  # ends the thread's wait for the next byte, and tells the service at once
            stream.extensions["network_stream"].get_extra_info("socket").shutdown(socket.SHUT_RDWR)


@contextmanager
def two_replicas(folder: Path, **changes: Any) -> Iterator[tuple[Service, Service]]:
    store = str(folder / "store")
    with running_service(folder / "1", store=store, replica="r1", **changes) as first:
        publish(first.catalog, "hall", "1", first.scratch)
        publish(first.catalog, "attic", "2", first.scratch)
        connect = {"zenoh_connect": (first.endpoint,)}
        with running_service(folder / "2", store=store, replica="r2", **connect, **changes) as second:
            for one in (first, second):
                wait_until(lambda one=one: len(one.http.get("/maps").json()["maps"]) == 2)
                for map_id in ("hall", "attic"):
                    wait_until(lambda one=one, map_id=map_id: one.ask_http(map_id=map_id).ok)
            yield first, second


def test_each_replica_shows_the_answers_of_both(tmp_path: Path):
    with two_replicas(tmp_path) as (first, second):
        for here, there, name in ((first, second, "r2"), (second, first, "r1")):
            with watching(here) as watch:
                assert watch.events[0] == {"replica": "r1" if here is first else "r2", "all_replicas": True}
                # nothing is told before the other one knows that somebody watches
                wait_until(lambda there=there, watch=watch, name=name: there.ask_http().ok and watch.of(name))
                told = watch.of(name)[-1]
                assert told["answer"]["map_id"] == "hall"
                assert told["answer"]["T_map_sensor"]["position"][0] == 1
                assert "hypotheses" not in told["answer"]
                assert told["robot"] == ""
                numbers = [one["number"] for one in watch.answers]
                assert numbers == sorted(set(numbers))


def test_the_name_of_a_robot_comes_from_the_other_replica(tmp_path: Path):
    with two_replicas(tmp_path) as (first, second), watching(first) as watch:

        def told() -> bool:
            assert second.ask_zenoh(key="firstfix/hall/localize/r2", options={"robot": "cart-07"}).ok
            return any(one["robot"] == "cart-07" for one in watch.of("r2"))

        wait_until(told)


def test_a_stream_about_one_map_has_no_other(tmp_path: Path):
    with two_replicas(tmp_path) as (first, second), watching(first, map_id="attic") as watch:

        def asked() -> bool:
            assert second.ask_http(map_id="hall").ok
            assert second.ask_http(map_id="attic").ok
            return len(watch.of("r2")) >= 3

        wait_until(asked)
        assert {one["answer"]["map_id"] for one in watch.answers} == {"attic"}


def test_answers_are_heard_only_while_somebody_watches(service: Service):
    with client_session(service.endpoint) as session, session.declare_publisher(f"{ANSWERS}/r9") as other:
        assert not other.matching_status.matching
        with watching(service):
            wait_until(lambda: other.matching_status.matching)
        wait_until(lambda: not other.matching_status.matching)


def test_foreign_answers_displace_no_own_answers(service: Service):
    assert service.ask_http().ok
    bad = [
        b"",
        b"not json",
        b"[" * 50_000,
        orjson.dumps([{**RECORD, "ms": "soon"}]),
        orjson.dumps([{**RECORD, "caller": "x" * 1000}]),
        orjson.dumps([{**RECORD, "robot": "x" * 1000}]),
        orjson.dumps([RECORD] * (MAX_RECORDS + 1)),
        b'[{"time_s": NaN}]',
        b" " * MAX_BYTES + orjson.dumps([RECORD]),
        orjson.dumps([{**RECORD, "answer": {**RECORD["answer"], "verdict": "<b>"}}]),
    ]
    with client_session(service.endpoint) as session, watching(service) as watch:

        def put(payload: bytes) -> None:
            session.put(f"{ANSWERS}/r9", payload, encoding=zenoh.Encoding.APPLICATION_JSON)

        def told() -> bool:
            put(orjson.dumps([RECORD]))
            return bool(watch.of("r9"))

        wait_until(told)
        before = len(watch.answers)
        own = watch.of("r1")
        assert own
        for payload in bad:
            put(payload)
        session.put(f"{ANSWERS}/r1", orjson.dumps([RECORD]))  # in this replica's own name

        def flooded() -> bool:  # zenoh may drop any of them
            for _ in range(MAX_ANSWERS // MAX_RECORDS + 5):
                put(orjson.dumps([RECORD] * MAX_RECORDS))
            return len(watch.answers) > before + MAX_RECORDS

        wait_until(flooded)
        assert all(one["answer"]["verdict"] in ("localized", "rejected") for one in watch.answers)
        assert watch.of("r1") == own
        with watching(service) as later:  # the flood has not displaced the replica's own answers
            wait_until(lambda: later.of("r1") == own)
        assert service.ask_http().ok


@serving(auth="on", keys_refresh_s=0.1, maps={})
def test_where_callers_need_a_key_only_the_replica_itself_is_shown(service: Service):
    headers = bearer(known(service, "admin"))
    with watching(service, headers) as watch:
        assert watch.events[0] == {"replica": "r1", "all_replicas": False}


@serving(auth="on", zenoh_trusted=True, keys_refresh_s=0.1, maps={})
def test_a_caller_hears_of_its_maps_alone(service: Service):
    everywhere = bearer(known(service, "admin"))
    hall = bearer(known(service, "build", maps=("hall",)))
    with (
        client_session(service.endpoint) as session,
        watching(service, everywhere) as all_maps,
        watching(service, hall) as one_map,
    ):
        assert one_map.events[0]["all_replicas"]
        about = [{**RECORD, "answer": {**RECORD["answer"], "map_id": name}} for name in ("attic", "", "hall")]

        def told() -> bool:
            session.put(f"{ANSWERS}/r9", orjson.dumps(about))
            return bool(one_map.of("r9")) and bool(all_maps.of("r9"))

        wait_until(told)
        assert {one["answer"]["map_id"] for one in all_maps.of("r9")} == {"attic", "", "hall"}
        assert {one["answer"]["map_id"] for one in one_map.of("r9")} == {"hall"}
