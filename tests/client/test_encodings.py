"""The client's encodings against a real server; for a descriptor it asks for the map's parameters."""

from __future__ import annotations

import json

import numpy as np
import pytest

from firstfix.answer.options import LocalizeOptions
from firstfix.engine.config import EngineConfig, OccupancyConfig, PcaScConfig
from firstfix.errors import DescriptorMismatch, NotFound, UnsupportedFormat
from firstfix.scan.compact import CompactScan, ScanDescriptor
from firstfix.scan.descriptor_parameters import DescriptorParameters
from firstfix.wire import query as wire_query
from firstfix_client import Client
from tests.client.answer_server import AnswerServer, ok, problem
from tests.client.fake_answers import SCAN, answer_bytes


def map_bytes(engine: EngineConfig) -> bytes:
    manifest = {"engine": engine.model_dump(mode="json")}
    return json.dumps({"map_id": "hall", "active_version": "ab" * 32, "manifest": manifest}).encode()


def of_range(max_range_m: float) -> EngineConfig:
    return EngineConfig(descriptor=OccupancyConfig(max_range_m=max_range_m))


def asked(server: AnswerServer) -> list[str]:
    return [f"{method} {path}" for method, path, *_ in server.requests]


def test_a_compact_query_asks_nothing_but_the_question(server):
    server.answers = [ok(answer_bytes())]
    Client(server.url).localize(SCAN, map_id="hall", encoding="compact")
    assert asked(server) == ["POST /localize"]
    *_, headers, body = server.requests[0]
    assert headers["content-type"] == wire_query.MEDIA_TYPE
    query = wire_query.decode_query(body)
    assert isinstance(query, CompactScan)
    assert query.described is None


def test_parameters_put_a_descriptor_beside_the_points(server):
    server.answers = [ok(answer_bytes())]
    parameters = DescriptorParameters.from_engine(of_range(25.0).model_dump())
    Client(server.url).localize(SCAN, map_id="hall", encoding="compact", parameters=parameters)
    query = wire_query.decode_query(server.requests[0][4])
    assert query.described.agrees_with(of_range(25.0).descriptor.make())


def test_the_maps_parameters_are_asked_for_once(server):
    client = Client(server.url)
    server.answers = [ok(map_bytes(of_range(25.0))), ok(answer_bytes())]
    down = LocalizeOptions(gravity=np.array([0.0, 0.6, -0.8]))
    for _ in range(2):
        client.localize(SCAN, map_id="hall", options=down, encoding="descriptor")
    assert asked(server) == ["GET /maps/hall", "POST /localize", "POST /localize"]
    query = wire_query.decode_query(server.requests[2][4])
    assert isinstance(query, ScanDescriptor)
    assert query.agrees_with(of_range(25.0).descriptor.make())
    np.testing.assert_allclose(query.up, [0, -0.6, 0.8], atol=1e-6)


def test_parameters_are_asked_for_again_when_the_map_has_changed(server):
    client = Client(server.url)
    server.answers = [ok(map_bytes(of_range(25.0))), ok(answer_bytes())]
    client.localize(SCAN, map_id="hall", encoding="descriptor")
    server.answers = [problem("descriptor_mismatch", 409), ok(map_bytes(of_range(31.0))), ok(answer_bytes())]
    client.localize(SCAN, map_id="hall", encoding="descriptor")
    assert asked(server)[2:] == ["POST /localize", "GET /maps/hall", "POST /localize"]
    assert wire_query.decode_query(server.requests[-1][4]).agrees_with(of_range(31.0).descriptor.make())


def test_a_mismatch_that_stays_is_an_error(server):
    server.answers = [ok(map_bytes(of_range(25.0))), problem("descriptor_mismatch", 409)]
    with pytest.raises(DescriptorMismatch):
        Client(server.url).localize(SCAN, map_id="hall", encoding="descriptor")
    assert len(server.requests) == 2


@pytest.mark.parametrize(
    ("answer", "error"),
    [
        (map_bytes(EngineConfig(descriptor=PcaScConfig())), UnsupportedFormat),
        (b'{"map_id": "hall", "active_version": null}', NotFound),
    ],
)
def test_a_map_without_a_robots_descriptor_is_refused(server, answer, error):
    server.answers = [ok(answer)]
    with pytest.raises(error):
        Client(server.url).localize(SCAN, map_id="hall", encoding="descriptor")
