"""Clouds that are no PointCloud2: compressed ones, and Livox' own message."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from firstfix.errors import InputError, MalformedData, TooLarge, UnsupportedFormat
from firstfix.formats import point_cloud
from firstfix.recording import compressed_cloud, live_clouds, livox
from firstfix.ros.point_cloud2 import decode_point_cloud2
from firstfix_ros.robot import cloud_types
from firstfix_ros.robot.cloud_types import CLOUD_TYPES, decode_cloud, missing_messages
from firstfix_ros.robot.status import State
from firstfix_ros.robot.topics import Input
from tests.every_case import every_case
from tests.live_clouds import TYPE_OF, live_cloud
from tests.ros2.test_robot_gateway import Bench, localized

POINTS = np.random.default_rng(3).uniform(-9, 9, (200, 3)).astype(np.float32)
NS = 7 * 10**9
FORMS = tuple(TYPE_OF)


def test_the_table_is_that_of_the_decoders():
    assert cloud_types.COMPRESSED == compressed_cloud.TYPE
    assert set(cloud_types.LIVOX) <= set(livox.TYPES)
    assert set(CLOUD_TYPES[1:]) <= set(live_clouds.DECODERS)


@every_case("form", FORMS)
def test_each_form_is_decoded_as_it_was_sent(form: str):
    found = decode_cloud(TYPE_OF[form], live_cloud(form, POINTS, NS, "lidar"))
    assert (found.header.frame_id, found.header.stamp.ns) == ("lidar", NS)
    np.testing.assert_array_equal(found.cloud.xyz, POINTS)


@every_case("form", FORMS)
def test_a_gateway_asks_with_each_form(form: str):
    bench = Bench(localized)
    bench.gateway.take(Input.CLOUD, live_cloud(form, POINTS, NS, "lidar"), TYPE_OF[form])
    assert bench.gateway.step()
    assert bench.gateway.status.state is State.LOCALIZED
    assert [len(scan) for scan, _ in bench.queries] == [len(POINTS)]


@every_case("form", FORMS)
def test_damage_and_size_are_told_and_the_next_cloud_is_asked_with(form: str):
    bench, good = Bench(localized), live_cloud(form, POINTS, NS, "lidar")
    for size in (0, 3, 30, len(good) // 2, len(good) - 5):
        with pytest.raises(InputError):
            decode_cloud(TYPE_OF[form], good[:size])
    bench.gateway.take(Input.CLOUD, good[: len(good) // 2], TYPE_OF[form])
    assert bench.gateway.step()
    assert bench.gateway.status.state is State.FAILED
    bench.now_s += 100
    bench.gateway.take(Input.CLOUD, good, TYPE_OF[form])
    assert bench.gateway.step()
    assert bench.gateway.status.state is State.LOCALIZED


def test_a_small_message_cannot_take_memory_without_limit(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(cloud_types, "SCAN_LIMITS", point_cloud.Limits(100, 10**6))
    for form in FORMS:
        with pytest.raises(TooLarge):
            decode_cloud(TYPE_OF[form], live_cloud(form, POINTS, NS, "lidar"))
    bomb = live_cloud("zlib", np.zeros((90, 3), np.float32), NS, "lidar")
    for number in (90, 90 * 12):  # it unpacks to ten times what its message declares
        bomb = bomb.replace(number.to_bytes(4, "little"), (number // 10).to_bytes(4, "little"), 1)
    with pytest.raises((MalformedData, TooLarge)):
        decode_cloud(TYPE_OF["zlib"], bomb)
    assert (
        len(decode_point_cloud2(live_cloud("plain", POINTS[:9], NS, "l"), point_cloud.SCAN_LIMITS).cloud) == 9
    )


def test_the_robots_part_alone_says_what_takes_them(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "firstfix.recording.live_clouds", None)
    assert len(decode_cloud(TYPE_OF["plain"], live_cloud("plain", POINTS, NS, "lidar")).cloud) == len(POINTS)
    for form, said in {"zstd": "point_cloud_transport republish", "livox": "xfer_format 0"}.items():
        with pytest.raises(UnsupportedFormat, match=f"install firstfix itself for .*{said}"):
            decode_cloud(TYPE_OF[form], live_cloud(form, POINTS, NS, "lidar"))


def test_a_missing_package_of_messages_is_named():
    said = missing_messages(TYPE_OF["livox"])
    assert "this Python has no livox_ros_driver2: source the workspace" in said
    assert "xfer_format 0" in said
