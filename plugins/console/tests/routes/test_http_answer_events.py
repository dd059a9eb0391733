"""The stream of answers: all that a caller may see, each once, and nothing of other callers' maps."""

from __future__ import annotations

import asyncio
import json
import socket
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import httpx
import orjson
import pytest
from prometheus_client import CollectorRegistry

from firstfix.answer.localization import Verdict
from firstfix_console import answer_events
from firstfix_service.auth.principal import Principal
from firstfix_service.http_api.event_stream import EventStreams
from firstfix_service.localize import recent_answers
from firstfix_service.localize.answer_counts import AnswerCounts, Counted
from firstfix_service.localize.recent_answers import RecentAnswers
from firstfix_service.query_workers.query import EncodedAnswer
from firstfix_service.telemetry.late_counts import LateCounts
from tests.service.access_world import give
from tests.service.raw_connection import connect
from tests.service.service_world import SCAN_BODY, XYZ, Service, publish, running_service
from tests.waiting import LIMIT_S, wait_until


def events(response: httpx.Response) -> Iterator[dict[str, Any]]:
    """The data of each event."""
    for line in response.iter_lines():
        if line.startswith("data: "):
            yield json.loads(line.removeprefix("data: "))


def watched(
    service: Service, count: int, headers: dict[str, str] | None = None, **params: Any
) -> list[dict[str, Any]]:
    """The first answers of a stream."""
    with service.http.stream(
        "GET", "/answers/events", params=params, headers=headers, timeout=LIMIT_S
    ) as stream:
        assert stream.status_code == 200
        coming = events(stream)
        assert set(next(coming)) == {"replica", "all_replicas"}
        return [next(coming) for _ in range(count)]


def test_answers_come_in_order_with_their_poses(service: Service):
    publish(service.catalog, "attic", "2", service.scratch)
    wait_until(lambda: service.ask("http", map_id="attic").ok)
    last = watched(service, 1)[-1]["number"]
    assert service.ask("http").ok
    assert service.ask("zenoh").ok
    assert service.ask("http", map_id="attic").ok
    told = watched(service, 3, after=last)
    assert [one["number"] for one in told] == [last + 1, last + 2, last + 3]
    assert [one["transport"] for one in told] == ["http", "zenoh", "http"]
    assert [one["answer"]["map_id"] for one in told] == ["hall", "hall", "attic"]
    assert told[0]["answer"]["verdict"] == "localized"
    assert told[0]["answer"]["T_map_sensor"]["position"][0] == 1
    assert told[0]["ms"] > 0
    assert [one["number"] for one in watched(service, 1, after=last, map_id="attic")] == [last + 3]


def test_answers_have_the_names_that_robots_gave(service: Service):
    wait_until(lambda: service.ask("http").ok)
    last = watched(service, 1)[-1]["number"]
    headers = {"Content-Type": XYZ, "X-Robot": "/hall/cart-07"}
    assert service.http.post("/localize?map=hall", content=SCAN_BODY, headers=headers).is_success
    assert service.ask_zenoh(options={"robot": "cart-12"}).ok
    assert service.ask("http").ok
    assert [one["robot"] for one in watched(service, 3, after=last)] == ["/hall/cart-07", "cart-12", ""]


@pytest.mark.parametrize("name", ["a b", "x" * 65, "<img>", "-7", "\u00e9"])
def test_a_malformed_name_is_refused_and_said(service: Service, name: str):
    headers = {"Content-Type": XYZ, "X-Robot": name.encode("latin-1")}
    answer = service.http.post("/localize?map=hall", content=SCAN_BODY, headers=headers)
    assert answer.status_code == 400
    assert answer.json()["code"] == "invalid_option"
    assert "not a robot's name (1 to 64 of A-Z a-z 0-9 . _ : @ / -)" in answer.json()["detail"]
    refused = service.ask_zenoh(options={"robot": name})
    assert not refused.ok
    assert b"not a robot's name" in refused.body


def test_a_watcher_sees_only_its_maps(tmp_path: Path):
    with running_service(tmp_path, auth="on", keys_refresh_s=0.1, zenoh=False) as service:
        for number, map_id in enumerate(("hall", "attic")):
            publish(service.catalog, map_id, str(number), service.scratch)
        everywhere = {"Authorization": f"Bearer {give(service, 'admin')}"}
        hall = {"Authorization": f"Bearer {give(service, 'build', maps=('hall',))}"}
        robot = {"Authorization": f"Bearer {give(service, 'localize')}"}

        def ask(map_id: str) -> bool:
            headers = {**everywhere, "Content-Type": XYZ}
            return service.http.post(f"/localize?map={map_id}", content=SCAN_BODY, headers=headers).is_success

        for map_id in ("attic", "hall"):
            wait_until(lambda map_id=map_id: ask(map_id))
        wait_until(lambda: service.http.get("/caller", headers=robot).is_success)
        assert ask("attic")
        assert ask("hall")
        assert {one["answer"]["map_id"] for one in watched(service, 2, everywhere)} == {"hall", "attic"}
        seen = watched(service, 1, hall)
        assert [one["answer"]["map_id"] for one in seen] == ["hall"]
        assert seen[0]["caller"].startswith("key:")
        assert seen[0]["robot"] == "test", "the name of its key"
        assert service.http.get("/answers/events?map_id=attic", headers=hall).status_code == 403
        assert service.http.get("/answers/events", headers=robot).status_code == 403


EVERYBODY = Principal("somebody")


def kept(count: int) -> RecentAnswers:
    recent = RecentAnswers("here")
    for number in range(count):
        answer = EncodedAnswer(Verdict.REJECTED, (), 0.0, "hall", "1" * 64, json=b'{"n":%d}' % number)
        recent.add("robot", "http", 0.1, answer, time_s=time.time())
    return recent


def test_answers_that_wait_to_be_counted_are_there_for_who_reads():
    late = LateCounts(CollectorRegistry())
    recent = RecentAnswers("here", late.make)
    counts = AnswerCounts(make_late=late.make)
    answer = EncodedAnswer(Verdict.LOCALIZED, (), 1.0, "hall", "1")
    late.add(partial(recent.add, "robot", "http", 0.1, answer, time_s=5.0))
    assert [one.time_s for one in recent.after(0)] == [5.0]
    late.add(partial(recent.add, "robot", "http", 0.1, answer, time_s=6.0))
    assert [one.time_s for one in recent.own_after(1)] == [6.0]
    late.add(counts.add, "hall", True, time.monotonic())
    assert [one.hour for one in counts.of_maps()] == [Counted(1, 1)]


async def first_look(recent: RecentAnswers) -> list[bytes]:
    parts = answer_events._events(recent, EVERYBODY, None, 0)
    await anext(parts)  # that it watches
    look = []
    while part := await anext(parts):
        look.append(part)
    return look


def test_the_events_of_a_look_come_together_in_parts_of_limited_size():
    count = 2 * answer_events.TOGETHER + 1
    look = asyncio.run(first_look(kept(count)))
    assert [part.count(b"event: answer") for part in look] == [answer_events.TOGETHER] * 2 + [1]
    data = [line for line in b"".join(look).decode().splitlines() if line.startswith("data: ")]
    assert [json.loads(line.removeprefix("data: "))["answer"]["n"] for line in data] == list(range(count))


def test_an_event_is_made_once_for_all_watchers(monkeypatch: pytest.MonkeyPatch):
    made = []

    def dumps(value: dict[str, Any]) -> bytes:
        made.append(value["number"])
        return orjson.dumps(value)

    monkeypatch.setattr(recent_answers, "orjson", SimpleNamespace(dumps=dumps))
    recent = kept(3)
    assert made == []  # nobody watches
    looks = [asyncio.run(first_look(recent)) for _ in range(10)]
    assert made == [1, 2, 3]
    assert all(look == looks[0] for look in looks)


def test_a_stream_ends_with_its_caller(service: Service):
    with connect(service) as connection:
        connection.sendall(b"GET /answers/events HTTP/1.1\r\nHost: x\r\n\r\n")
        assert b"watching" in connection.recv(1 << 16)
        connection.shutdown(socket.SHUT_WR)
        wait_until(lambda: service.app.state.start.parts[EventStreams].limit.taken == 0)
