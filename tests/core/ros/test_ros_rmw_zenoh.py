"""The layout of rmw_zenoh, against the examples of its own design page and rosbags' type hashes."""

from __future__ import annotations

import pytest
import zenoh

from firstfix.errors import MalformedData
from firstfix.ros import imu, point_cloud2, pose_message, tf_message
from firstfix.ros.rmw_zenoh import (
    PUBLISHER,
    RELIABLE_QOS,
    SERVICE,
    Attachment,
    Node,
    dds_type,
    endpoint,
    parse_token,
    publishers_pattern,
)
from firstfix.ros.type_hashes import DIAGNOSTICS, POSE_ARRAY, TRIGGER
from tests.every_case import every_case
from tests.ros_samples import ROS2

STRING_HASH = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
TALKER = (
    "@ros2_lv/2/8b20917502ee955ac4476e0266340d5c/0/10/MP/%/%/talker/%chatter/std_msgs::msg::dds_::String_/"
    f"{STRING_HASH}/::,7:,:,:,,"
)


def test_tokens_are_those_of_the_design_page():
    talker = parse_token(TALKER)
    assert talker is not None
    assert (talker.kind, talker.topic, talker.is_humble) == (PUBLISHER, "/chatter", False)
    assert talker.key == f"2/chatter/std_msgs::msg::dds_::String_/{STRING_HASH}"
    node = Node(2, "8b20917502ee955ac4476e0266340d5c", "talker")
    assert node.endpoint_token(10, talker, "::,7:,:,:,,") == TALKER
    assert dds_type("sensor_msgs/msg/PointCloud2") == "sensor_msgs::msg::dds_::PointCloud2_"
    assert Node(2, "aac3", "listener").token == "@ros2_lv/2/aac3/0/0/NN/%/%/listener"


def test_a_topic_in_a_namespace():
    pose = endpoint(0, PUBLISHER, "/robot1/initialpose", pose_message.TYPE)
    dds = "geometry_msgs::msg::dds_::PoseWithCovarianceStamped_"
    assert pose.key == f"0/robot1/initialpose/{dds}/{pose.type_hash}"
    token = Node(0, "abc", "gateway").endpoint_token(3, pose, RELIABLE_QOS)
    assert parse_token(token) == pose
    assert "/%robot1%initialpose/" in token


@every_case(
    "ros_type", [imu.TYPE, point_cloud2.TYPE, pose_message.TYPE, tf_message.TYPE, POSE_ARRAY, DIAGNOSTICS]
)
def test_hashes_are_those_of_the_message_definitions(ros_type):
    assert endpoint(0, PUBLISHER, "/x", ros_type).type_hash == ROS2.hash_rihs01(ros_type)


def test_humble_has_no_hashes():
    locate = endpoint(0, SERVICE, "/first_fix/relocalize", TRIGGER, humble=True)
    assert locate.key == "0/first_fix/relocalize/std_srvs::srv::dds_::Trigger_/TypeHashNotSupported"
    assert locate.is_humble


def test_the_pattern_matches_publishers_of_the_type_alone():
    pattern = zenoh.KeyExpr(publishers_pattern(2, "std_msgs/msg/String"))
    assert pattern.intersects(zenoh.KeyExpr(TALKER))
    assert pattern.intersects(zenoh.KeyExpr(TALKER + "/cpu:")), "rolling adds a part"
    assert not pattern.intersects(zenoh.KeyExpr(TALKER.replace("/MP/", "/MS/")))
    assert not pattern.intersects(zenoh.KeyExpr(TALKER.replace("String_", "Header_")))
    assert not pattern.intersects(zenoh.KeyExpr(TALKER.replace("@ros2_lv/2/", "@ros2_lv/3/")))


@every_case(
    "key",
    [
        "",
        "@ros2_lv/2/aac3/0/0/NN/%/%/listener",
        TALKER.replace("@ros2_lv", "firstfix"),
        TALKER.replace("/2/", "/two/"),
        TALKER.replace("%chatter", "chatter"),
    ],
)
def test_another_key_is_no_endpoints_token(key):
    assert parse_token(key) is None


def test_an_attachment_is_33_bytes():
    attachment = Attachment(1, 1_700_000_000_000_000_001, bytes(range(16)))
    raw = attachment.to_bytes()
    assert raw == (
        b"\x01" + bytes(7) + (1_700_000_000_000_000_001).to_bytes(8, "little") + b"\x10" + bytes(range(16))
    )
    assert Attachment.from_bytes(raw) == attachment
    # as zenoh's own serialiser, which rmw_zenoh uses, writes it
    parts = [zenoh.ext.Int64(1), zenoh.ext.Int64(attachment.stamp_ns), attachment.gid]
    assert b"".join(zenoh.ext.z_serialize(part).to_bytes() for part in parts) == raw


@every_case("raw", [b"", bytes(33), b"\x0fsequence_number" + bytes(61)])
def test_other_attachments_are_malformed(raw):
    with pytest.raises(MalformedData):
        Attachment.from_bytes(raw)
