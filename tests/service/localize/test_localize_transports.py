"""The same tests over both transports, which must answer and refuse with the same bytes."""

from __future__ import annotations

import gzip
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest
import zenoh
import zstandard

from firstfix.answer.localization import Localization, Reason, Verdict
from firstfix.errors import all_errors
from firstfix.ros.media_types import POINT_CLOUD2, POSE
from firstfix.ros.pose_message import TYPE
from firstfix.scan.compact import CompactScan
from firstfix.scan.reduction import COLUMNS, ROWS
from firstfix.scan.scan import Scan
from firstfix.wire import query as wire_query
from firstfix.wire import sequence as wire_sequence
from tests.hostile_bodies import npy, pcd
from tests.hostile_bodies import rows as rows_of_text
from tests.ros_samples import ROS2, cdr, cloud_of_points
from tests.service.service_world import SCAN_BODY, XYZ, Reply, Service, publish, serving
from tests.waiting import wait_until

both = pytest.mark.parametrize("transport", ["http", "zenoh"])
CLOUD = cdr(cloud_of_points(np.ones((40, 3)), stamp_ns=1_700_000_000_123_456_789))


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
def test_a_body_without_a_telling_media_type_says_itself_what_it_is(shared_service: Service, transport: str):
    rows = np.random.default_rng(3).uniform(-9, 9, (100, 3)).astype("<f4")
    for body in (npy(rows), pcd(rows, "binary"), rows_of_text(rows, ","), CLOUD):
        for media_type in ("application/octet-stream", "application/x-www-form-urlencoded", ""):
            assert shared_service.ask(transport, body=body, media_type=media_type).ok, (body[:20], media_type)
    refused = shared_service.ask(transport, body=rows.tobytes(), media_type="application/octet-stream")
    assert (refused.json["code"], refused.json["status"]) == ("unsupported_format", 415)
    assert "application/vnd.firstfix.xyz" in refused.json["detail"]
    stripped = pcd(rows, "ascii").replace(b"\n", b"")
    refused = shared_service.ask(transport, body=stripped, media_type="application/x-pcd")
    assert "--data-binary" in refused.json["detail"]


@both
def test_a_misspelt_option_is_answered_with_the_nearest_one(shared_service: Service, transport: str):
    for name, meant in (
        ("map_id", "map"),
        ("mapp", "map"),
        ("min_probabilty", "min_probability"),
        ("t_base_sensor", "T_base_sensor"),
        ("frame_id", "frame"),
        ("Gravity", "gravity"),
        ("deadline", "deadline_ms"),
    ):
        reply = shared_service.ask(transport, options={name: "1"})
        assert f"no option {name}: did you mean {meant}?" in reply.json["detail"]
    assert shared_service.ask(transport, options={"colour": "1"}).json["detail"] == "no option colour"


@both
def test_a_compact_query_is_answered(shared_service: Service, transport: str):
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
def test_compressed_bodies_are_decoded(shared_service: Service, transport: str, encoding: str, compress):
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
    "another message": (
        {"media_type": "application/vnd.ros2.cdr; type=sensor_msgs/msg/Imu"},
        "unsupported_format",
        415,
    ),
    "a damaged cloud": ({"body": CLOUD[:-9], "media_type": POINT_CLOUD2}, "malformed_data", 400),
    "not pcd": ({"media_type": "application/x-pcd"}, "malformed_data", 400),
}


@pytest.mark.parametrize("case", BAD)
def test_both_transports_refuse_with_the_same_bytes(shared_service: Service, case: str):
    query, code, status = BAD[case]
    http, zenoh = shared_service.ask("http", **query), shared_service.ask("zenoh", **query)
    assert (http.json["code"], http.json["status"]) == (code, status)
    assert http.body == zenoh.body
    assert not http.ok
    assert not zenoh.ok
    assert http.media_type == zenoh.media_type == "application/problem+json"


@pytest.mark.parametrize("error", all_errors(), ids=lambda cls: cls.__name__)
def test_every_error_has_the_same_bytes_on_both_transports(shared_service, error, monkeypatch):
    monkeypatch.setattr(shared_service.behaviour, "raises", error("the very reason"))
    http, zenoh = shared_service.ask("http"), shared_service.ask("zenoh")
    assert http.body == zenoh.body
    assert (http.json["code"], http.json["detail"]) == (error.code, "the very reason")


@both
def test_an_unexpected_error_tells_no_detail(shared_service, transport, monkeypatch):
    monkeypatch.setattr(shared_service.behaviour, "raises", RuntimeError("secret path /etc/firstfix"))
    reply = shared_service.ask(transport)
    assert (reply.json["code"], reply.json["status"]) == ("internal", 500)
    assert b"secret" not in reply.body
    monkeypatch.undo()
    assert shared_service.ask(transport).ok, "it goes on serving"


@serving(max_body_bytes=1200)
@both
def test_a_body_over_the_limit_is_refused(service: Service, transport: str):
    assert service.ask(transport).ok
    assert service.ask(transport, body=SCAN_BODY + bytes(12)).json["code"] == "too_large"
    bomb = gzip.compress(bytes(12 * 1000))
    assert len(bomb) < 1200
    reply = service.ask(transport, body=bomb, content_encoding="gzip")
    assert (reply.json["code"], reply.json["status"]) == ("too_large", 413)


@serving(is_gated=True, workers=1, queue_size=1)
@both
def test_a_full_queue_refuses_at_once(service: Service, transport: str):
    with ThreadPoolExecutor(2) as threads:
        waiting = [threads.submit(service.ask, transport) for _ in range(2)]
        wait_until(lambda: service.value("firstfix_queries_admitted") == 2)
        refused = service.ask(transport)
        assert (refused.json["code"], refused.json["status"]) == ("overloaded", 503)
        service.open_gate()
        assert all(reply.result().ok for reply in waiting), "those that were let in are answered"


@serving(is_gated=True)
@both
def test_a_query_over_its_deadline_gets_504(service: Service, transport: str):
    reply = service.ask(transport, options={"deadline_ms": "150"})
    assert (reply.json["code"], reply.json["status"]) == ("deadline_exceeded", 504)
    service.open_gate()
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


def ask_for(
    service: Service,
    transport: str,
    accept: str,
    body: bytes = CLOUD,
    media_type: str = POINT_CLOUD2,
    options: dict[str, str] | None = None,
    content_encoding: str = "identity",
) -> Reply:
    """Sends one query with an Accept header, or zenoh's parameter for it."""
    options = options or {}
    if transport == "zenoh":
        options = {"accept": accept.partition(";")[0], **options}  # a semicolon separates parameters
        return service.ask_zenoh(body, media_type, "hall", options, content_encoding)
    headers = {"Content-Type": media_type, "Accept": accept, "Content-Encoding": content_encoding}
    answer = service.http.post("/localize", params={"map": "hall", **options}, content=body, headers=headers)
    return Reply(answer.status_code == 200, answer.content, answer.headers["content-type"])


def pose_of(reply: Reply) -> Any:
    assert (reply.ok, reply.media_type) == (True, POSE)
    return ROS2.deserialize_cdr(reply.body, TYPE)


@both
def test_the_pose_message_has_the_stamp_of_the_cloud_and_the_frame_of_the_map(
    shared_service: Service, transport: str
):
    message = pose_of(ask_for(shared_service, transport, POSE))
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (1_700_000_000, 123_456_789)
    assert message.header.frame_id == "map"
    position = message.pose.pose.position
    assert (position.x, position.y, position.z) == (1, 40, 0)
    np.testing.assert_array_equal(message.pose.covariance, np.eye(6).ravel())


@both
@pytest.mark.parametrize(
    ("encoding", "compress"), [("gzip", gzip.compress), ("zstd", zstandard.ZstdCompressor().compress)]
)
def test_the_stamp_is_found_under_a_content_encoding(shared_service, transport, encoding, compress):
    for media_type in (POINT_CLOUD2, "application/octet-stream"):
        reply = ask_for(
            shared_service, transport, POSE, compress(CLOUD), media_type, content_encoding=encoding
        )
        assert pose_of(reply).header.stamp.nanosec == 123_456_789


@both
def test_frame_and_stamp_can_be_given(shared_service: Service, transport: str):
    message = pose_of(
        ask_for(shared_service, transport, POSE, options={"frame": "hall/map", "stamp": "7.000000001"})
    )
    assert message.header.frame_id == "hall/map"
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (7, 1)


def test_zenohs_own_name_for_cdr_is_known(shared_service: Service):
    encoding = zenoh.Encoding.APPLICATION_CDR.with_schema("sensor_msgs/msg/PointCloud2")
    reply = shared_service.ask(
        "zenoh", body=CLOUD, media_type=encoding, options={"accept": "application/cdr"}
    )
    assert pose_of(reply).header.stamp.nanosec == 123_456_789


@both
def test_another_scan_gives_a_pose_message_without_a_stamp(shared_service: Service, transport: str):
    message = pose_of(ask_for(shared_service, transport, POSE, SCAN_BODY, XYZ))
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (0, 0)


@both
@pytest.mark.parametrize("accept", ["application/json", ""])
def test_json_is_the_default(shared_service: Service, transport: str, accept: str):
    reply = ask_for(shared_service, transport, accept)
    assert (reply.media_type, reply.json["T_map_sensor"]["position"]) == ("application/json", [1, 40, 0])


@both
@pytest.mark.parametrize("verdict", [Verdict.REJECTED, Verdict.AMBIGUOUS])
def test_an_answer_without_a_pose_is_json(shared_service: Service, transport: str, verdict, monkeypatch):
    answer = Localization(verdict, (Reason.SEVERAL_PLACES,), map_id="hall")
    monkeypatch.setattr(shared_service.behaviour, "answers", lambda *_: answer)
    reply = ask_for(shared_service, transport, POSE)
    assert (reply.ok, reply.media_type) == (True, "application/json")
    assert (reply.json["verdict"], reply.json["T_map_sensor"]) == (verdict.value, None)


@both
@pytest.mark.parametrize(
    ("accept", "options"),
    [
        (POSE, {"frame": ""}),
        (POSE, {"stamp": "now"}),
        ("application/json", {"frame": "map"}),
        (POSE, {"frme": "map"}),
    ],
)
def test_invalid_frames_and_stamps_are_refused(shared_service: Service, transport: str, accept, options):
    reply = ask_for(shared_service, transport, accept, options=options)
    assert (reply.ok, reply.json["code"]) == (False, "invalid_option")
