"""PointCloud2 queries and pose messages over both transports; JSON for answers without a pose."""

from __future__ import annotations

import gzip
from typing import Any

import numpy as np
import pytest
import zenoh
import zstandard

from firstfix.answer.localization import Localization, Reason, Verdict
from firstfix.answer.options import LocalizeOptions
from firstfix.ros.media_types import POINT_CLOUD2, POSE
from firstfix.ros.pose_message import TYPE
from tests.ros_samples import ROS2, cdr, cloud_of_points
from tests.service.service_world import SCAN_BODY, XYZ, Reply, Service

BODY = cdr(cloud_of_points(np.ones((40, 3)), stamp_ns=1_700_000_000_123_456_789))
both = pytest.mark.parametrize("transport", ["http", "zenoh"])


def ask(
    service: Service,
    transport: str,
    accept: str,
    body: bytes = BODY,
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
def test_a_cloud_is_a_scan(shared_service: Service, transport: str):
    answer = shared_service.ask(transport, body=BODY, media_type=POINT_CLOUD2)
    assert answer.media_type == "application/json"
    assert answer.json["T_map_sensor"]["position"] == [1, 40, 0]


@both
def test_the_pose_message_has_the_clouds_stamp_and_the_maps_frame(shared_service: Service, transport: str):
    message = pose_of(ask(shared_service, transport, POSE))
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (1_700_000_000, 123_456_789)
    assert message.header.frame_id == "map"
    position = message.pose.pose.position
    assert (position.x, position.y, position.z) == (1, 40, 0)
    np.testing.assert_array_equal(message.pose.covariance, np.eye(6).ravel())


@both
@pytest.mark.parametrize(
    ("encoding", "compress"), [("gzip", gzip.compress), ("zstd", zstandard.ZstdCompressor().compress)]
)
def test_the_stamp_is_found_under_a_content_encoding(
    shared_service: Service, transport: str, encoding: str, compress
):
    message = pose_of(ask(shared_service, transport, POSE, compress(BODY), content_encoding=encoding))
    assert message.header.stamp.nanosec == 123_456_789


@both
def test_frame_and_stamp_can_be_said(shared_service: Service, transport: str):
    message = pose_of(
        ask(shared_service, transport, POSE, options={"frame": "hall/map", "stamp": "7.000000001"})
    )
    assert message.header.frame_id == "hall/map"
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (7, 1)


@both
def test_any_scan_can_be_answered_so(shared_service: Service, transport: str):
    message = pose_of(ask(shared_service, transport, POSE, SCAN_BODY, XYZ))
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (0, 0)


@both
@pytest.mark.parametrize("accept", ["application/json", "*/*", ""])
def test_who_does_not_ask_for_it_gets_json(shared_service: Service, transport: str, accept: str):
    assert ask(shared_service, transport, accept).media_type == "application/json"


@both
@pytest.mark.parametrize("verdict", [Verdict.REJECTED, Verdict.AMBIGUOUS])
def test_an_answer_without_a_pose_is_json(shared_service: Service, transport: str, verdict, monkeypatch):
    answer = Localization(verdict, (Reason.SEVERAL_PLACES,), map_id="hall")
    monkeypatch.setattr("tests.service.service_world.FakeLocalizer.localize", lambda *_: answer)
    reply = ask(shared_service, transport, POSE)
    assert (reply.ok, reply.media_type) == (True, "application/json")
    assert (reply.json["verdict"], reply.json["T_map_sensor"]) == (verdict.value, None)


BAD = {
    "frame": (POSE, {"frame": ""}, "invalid_option"),
    "stamp": (POSE, {"stamp": "now"}, "invalid_option"),
    "frame for JSON": ("application/json", {"frame": "map"}, "invalid_option"),
    "unknown option": (POSE, {"frme": "map"}, "invalid_option"),
}


@both
@pytest.mark.parametrize("case", BAD)
def test_what_cannot_be_used_is_an_error(shared_service: Service, transport: str, case: str):
    accept, options, code = BAD[case]
    reply = ask(shared_service, transport, accept, options=options)
    assert (reply.ok, reply.media_type) == (False, "application/problem+json")
    assert reply.json["code"] == code


@both
def test_another_message_or_a_damaged_one_is_refused(shared_service: Service, transport: str):
    imu = "application/vnd.ros2.cdr; type=sensor_msgs/msg/Imu"
    assert shared_service.ask(transport, body=BODY, media_type=imu).json["code"] == "unsupported_format"
    damaged = shared_service.ask(transport, body=BODY[:-9], media_type=POINT_CLOUD2)
    assert damaged.json["code"] == "malformed_data"


def test_zenohs_own_name_for_cdr(shared_service: Service):
    encoding = zenoh.Encoding.APPLICATION_CDR.with_schema("sensor_msgs/msg/PointCloud2")
    reply = shared_service.ask("zenoh", body=BODY, media_type=encoding, options={"accept": "application/cdr"})
    assert pose_of(reply).header.stamp.nanosec == 123_456_789


def test_the_openapi_document_tells_of_it(shared_service: Service):
    call = shared_service.http.get("/openapi.json").json()["paths"]["/localize"]["post"]
    assert {"frame", "stamp", *LocalizeOptions.__dataclass_fields__} < {p["name"] for p in call["parameters"]}
    assert "application/vnd.ros2.cdr" in call["requestBody"]["content"]
    assert POSE in call["responses"]["200"]["content"]
