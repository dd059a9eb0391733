"""The same tests over both transports, which must refuse with the same bytes."""

from __future__ import annotations

import gzip
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
import zstandard

from firstfix.answer.localization import Localization, Verdict
from firstfix.errors import all_errors
from firstfix.scan.compact import CompactScan
from firstfix.scan.reduction import COLUMNS, ROWS
from firstfix.scan.scan import Scan
from firstfix.wire import query as wire_query
from firstfix.wire import sequence as wire_sequence
from tests.service.service_world import SCAN_BODY, XYZ, Behaviour, Service, publish, running_service
from tests.waiting import wait_until

both = pytest.mark.parametrize("transport", ["http", "zenoh"])


@both
def test_a_scan_is_answered(shared_service: Service, transport: str):
    version = shared_service.catalog.active_version("hall")
    reply = shared_service.ask(transport)
    answer = Localization.from_mapping(reply.json)
    assert reply.ok
    assert reply.media_type == "application/json"
    assert answer.verdict is Verdict.LOCALIZED
    assert answer.T_map_sensor is not None
    assert answer.T_map_sensor[:3, 3].tolist() == [1, 100, 0]
    assert (answer.map_id, answer.map_version) == ("hall", version)
    assert list(answer.timings_ms) == ["queue", "map", "decode", "search"]


@both
def test_an_answer_of_a_provisional_version_says_so(shared_service: Service, transport: str):
    name, catalog, scratch = f"early-{transport}", shared_service.catalog, shared_service.scratch
    publish(catalog, name, "1", scratch, provisional=True)
    wait_until(lambda: shared_service.ask(transport, map_id=name).ok)
    assert Localization.from_mapping(shared_service.ask(transport, map_id=name).json).map_provisional
    version = publish(catalog, name, "2", scratch)
    wait_until(lambda: shared_service.ask(transport, map_id=name).json["map_version"] == version)
    assert not Localization.from_mapping(shared_service.ask(transport, map_id=name).json).map_provisional


@both
def test_several_scans_are_one_query(shared_service: Service, transport: str):
    scan = Scan(np.arange(30, dtype=np.float32).reshape(10, 3))
    body = wire_sequence.encode_scans([scan] * 3, [np.eye(4)] * 3)
    reply = shared_service.ask(transport, body=body, media_type=wire_sequence.MEDIA_TYPE)
    assert reply.json["T_map_sensor"]["position"][1] == 3  # the fake's y is the sequence's length


@both
def test_a_compact_query_is_one(shared_service: Service, transport: str):
    nearest_m = np.full(ROWS * COLUMNS, np.inf, np.float32)
    body = wire_query.encode_query(CompactScan(np.ones((7, 3), np.float32), nearest_m))
    reply = shared_service.ask(transport, body=body, media_type=wire_query.MEDIA_TYPE)
    assert reply.json["T_map_sensor"]["position"][1] == 7  # the fake's y is the query's points
    refused = shared_service.ask(transport, body=body[:-1], media_type=wire_query.MEDIA_TYPE)
    assert refused.json["code"] == "malformed_data"


def test_the_transports_give_the_same_answer(shared_service: Service):
    http, zenoh = shared_service.ask("http").json, shared_service.ask("zenoh").json
    del http["timings_ms"], zenoh["timings_ms"]
    assert http == zenoh


@both
@pytest.mark.parametrize(
    ("encoding", "compress"),
    [("gzip", gzip.compress), ("zstd", zstandard.ZstdCompressor().compress), ("identity", bytes)],
)
def test_content_encodings_are_undone(shared_service: Service, transport: str, encoding: str, compress):
    reply = shared_service.ask(transport, body=compress(SCAN_BODY), content_encoding=encoding)
    assert reply.json["T_map_sensor"]["position"][1] == 100


BAD = {
    "unknown map": ({"map_id": "attic"}, "not_found", 404),
    "no map id": ({"map_id": "-bad-"}, "invalid_option", 400),
    "unknown option": ({"options": {"speed": "9"}}, "invalid_option", 400),
    "bad option": ({"options": {"min_probability": "2"}}, "invalid_option", 400),
    "two thresholds": (
        {"options": {"min_probability": "0.9", "max_false_accept": "0.1"}},
        "invalid_option",
        400,
    ),
    "bad version": ({"options": {"version": "abc"}}, "invalid_option", 400),
    "unknown version": ({"options": {"version": "0" * 64}}, "not_found", 404),
    "media type": ({"media_type": "image/png"}, "unsupported_format", 415),
    "encoding": ({"content_encoding": "br"}, "unsupported_format", 415),
    "truncated": ({"body": SCAN_BODY[:-1]}, "malformed_data", 400),
    "not gzip": ({"content_encoding": "gzip"}, "malformed_data", 400),
    "not pcd": ({"media_type": "application/x-pcd"}, "malformed_data", 400),
}


@pytest.mark.parametrize("case", BAD)
def test_both_refuse_with_the_same_bytes(shared_service: Service, case: str):
    query, code, status = BAD[case]
    http, zenoh = shared_service.ask("http", **query), shared_service.ask("zenoh", **query)
    assert (http.json["code"], http.json["status"]) == (code, status)
    assert http.body == zenoh.body
    assert not http.ok
    assert not zenoh.ok
    assert http.media_type == zenoh.media_type == "application/problem+json"


@pytest.mark.parametrize("error", all_errors(), ids=lambda cls: cls.__name__)
def test_every_error_crosses_both_alike(shared_service, error, monkeypatch):
    monkeypatch.setattr(shared_service.behaviour, "raises", error("the very reason"))
    http, zenoh = shared_service.ask("http"), shared_service.ask("zenoh")
    assert http.body == zenoh.body
    assert (http.json["code"], http.json["detail"]) == (error.code, "the very reason")


@both
def test_an_unexpected_error_tells_nothing(shared_service, transport, monkeypatch):
    monkeypatch.setattr(shared_service.behaviour, "raises", RuntimeError("secret path /etc/firstfix"))
    reply = shared_service.ask(transport)
    assert (reply.json["code"], reply.json["status"]) == ("internal", 500)
    assert b"secret" not in reply.body
    monkeypatch.undo()
    assert shared_service.ask(transport).ok, "it goes on serving"


@both
def test_a_body_over_the_limit_is_refused(tmp_path: Path, transport: str):
    with running_service(tmp_path, max_body_bytes=1200) as service:
        publish(service.catalog, "hall", "1", service.scratch)
        assert service.ask(transport).ok
        assert service.ask(transport, body=SCAN_BODY + bytes(12)).json["code"] == "too_large"
        bomb = gzip.compress(bytes(12 * 1000))
        assert len(bomb) < 1200
        reply = service.ask(transport, body=bomb, content_encoding="gzip")
        assert (reply.json["code"], reply.json["status"]) == ("too_large", 413)


@both
def test_a_full_queue_says_so_at_once(tmp_path: Path, transport: str):
    behaviour = Behaviour(gate=threading.Event())
    with (
        running_service(tmp_path, behaviour=behaviour, workers=1, queue_size=1) as service,
        ThreadPoolExecutor(2) as threads,
    ):
        publish(service.catalog, "hall", "1", service.scratch)
        waiting = [threads.submit(service.ask, transport) for _ in range(2)]
        wait_until(lambda: "firstfix_queries_admitted 2.0" in service.http.get("/metrics").text)
        refused = service.ask(transport)
        assert (refused.json["code"], refused.json["status"]) == ("overloaded", 503)
        assert behaviour.gate is not None
        behaviour.gate.set()
        assert all(reply.result().ok for reply in waiting), "those that were let in are answered"


@both
def test_a_deadline_is_kept(tmp_path: Path, transport: str):
    behaviour = Behaviour(gate=threading.Event())
    with running_service(tmp_path, behaviour=behaviour) as service:
        publish(service.catalog, "hall", "1", service.scratch)
        reply = service.ask(transport, options={"deadline_ms": "150"})
        assert (reply.json["code"], reply.json["status"]) == ("deadline_exceeded", 504)
        behaviour.gate.set()
        assert service.ask(transport, options={"deadline_ms": "600000"}).ok


@both
def test_another_version_can_be_named(shared_service: Service, transport: str):
    yard = f"yard-{transport}"
    first = publish(shared_service.catalog, yard, "1", shared_service.scratch)
    wait_until(lambda: shared_service.ask(transport, map_id=yard).x == 1)
    publish(shared_service.catalog, yard, "2", shared_service.scratch)
    wait_until(lambda: shared_service.ask(transport, map_id=yard).x == 2)
    assert shared_service.ask(transport, map_id=yard, options={"version": first}).x == 1


def test_media_type_parameters_are_ignored(shared_service: Service):
    assert shared_service.ask("http", media_type=f"{XYZ.upper()}; charset=binary").ok
