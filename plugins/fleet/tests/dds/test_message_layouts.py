"""Every message on DDS has the bytes that its ROS definition gives it: rosbags' serializer is the judge.

The contents are drawn with a seed, with what makes layouts differ: empty texts, texts of all lengths before
numbers of 4 and 8 bytes, empty sequences, and sequences of messages with texts in them.
"""

from __future__ import annotations

import random
from typing import Any

import numpy as np
import pytest
from cyclonedds.idl import make_idl_struct
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from firstfix.answer.localization import Localization, Verdict
from firstfix.ros.header import Header, Stamp
from firstfix.ros.imu import decode_imu
from firstfix.ros.pose_message import to_pose_cdr
from firstfix.ros.rmw_zenoh import dds_type
from firstfix.ros.tf_message import decode_tf, encode_tf
from firstfix.transform import from_quaternion, quaternion_of
from firstfix_fleet.dds.messages import FIELDS, TYPES, body_of
from firstfix_fleet.dds.trigger_service import request_header, trigger_reply
from firstfix_ros.messages.diagnostic_array import Diagnosis, encode_diagnostic_array
from firstfix_ros.messages.own_pose import decode_own_pose
from firstfix_ros.messages.pose_array import encode_pose_array
from tests.lidar_messages import COMPRESSED, COMPRESSED_CLOUD, CUSTOM, CUSTOM_POINT

ROS = get_typestore(Stores.ROS2_HUMBLE)
# Services are not in rosbags' stores. Before a request and a reply, rmw_cyclonedds has its own 16 bytes.
ROS.register(get_types_from_msg("uint8 structure_needs_at_least_one_member", "std_srvs/msg/Trigger_Request"))
_REPLY = "uint64 client\nint64 number\nbool success\nstring message"
ROS.register(get_types_from_msg(_REPLY, "std_srvs/msg/Trigger_Response"))
ROS.register(get_types_from_msg(COMPRESSED, COMPRESSED_CLOUD))
for _package in ("livox_ros_driver2", "livox_interfaces"):
    ROS.register(get_types_from_msg(CUSTOM_POINT, f"{_package}/msg/CustomPoint"))
    ROS.register(get_types_from_msg(CUSTOM, f"{_package}/msg/CustomMsg"))
INTEGERS = {"uint8", "int8", "uint16", "int16", "uint32", "int32", "uint64", "int64"}
CASES = 40


def expected_of(ros_type: str, content: dict[str, Any]) -> bytes:
    """The content's bytes by rosbags."""
    ros_type = ros_type.replace("/srv/", "/msg/")  # where rosbags has all its types
    return bytes(ROS.serialize_cdr(for_rosbags((Nodetype.NAME, ros_type), content), ros_type))


def drawn(field: Any, chance: random.Random) -> Any:
    """A value of a field: numbers, texts, lists, and dictionaries for messages."""
    kind, of = field
    if kind is Nodetype.BASE:
        name = of[0]
        if name == "string":
            return "".join(chance.choices("abcdefgé/_", k=chance.choice([0, 0, 1, 2, 3, 4, 5, 6, 7, 13])))
        if name == "bool":
            return chance.random() < 0.5
        if name == "byte":  # rosbags takes it for signed: the layout is the same
            return chance.randint(0, 127)
        if name in INTEGERS:
            kind_of = np.iinfo(name)
            return chance.randint(int(kind_of.min), int(kind_of.max))
        number = chance.uniform(-1e6, 1e6)
        return float(np.float32(number)) if name == "float32" else number
    if kind is Nodetype.NAME:
        return {name: drawn(inner, chance) for name, inner in ROS.fielddefs[of][1]}
    element, count = of
    return [drawn(element, chance) for _ in range(count or chance.choice([0, 1, 2, 3, 5]))]


def for_rosbags(field: Any, value: Any) -> Any:
    kind, of = field
    if kind is Nodetype.NAME:
        fields = dict(ROS.fielddefs[of][1])
        return ROS.types[of](**{name: for_rosbags(fields[name], inner) for name, inner in value.items()})
    if kind in (Nodetype.ARRAY, Nodetype.SEQUENCE):
        element = of[0]
        if element[0] is Nodetype.BASE and element[1][0] != "string":
            return np.array(value, dtype=element[1][0])
        return [for_rosbags(element, inner) for inner in value]
    return value


def for_dds(kind: Any, value: Any) -> Any:
    """The value as the IDL type has it: dictionaries become structs."""
    if isinstance(value, dict):
        inner = kind.__annotations__
        return kind(**{name: for_dds(inner[name], one) for name, one in value.items()})
    if isinstance(value, list):
        return [for_dds(getattr(kind, "subtype", None) or kind.__metadata__[0].subtype, one) for one in value]
    return value


def typed(ros_type: str) -> Any:
    """The gateway's IDL type with cyclonedds' own serializer, which the gateway does not use."""
    name = dds_type(ros_type)
    return make_idl_struct(name.rpartition("::")[2], name, FIELDS[ros_type])


def cases(ros_type: str) -> list[tuple[dict[str, Any], bytes]]:
    """Contents, and their bytes by rosbags."""
    chance = random.Random(ros_type)
    field = Nodetype.NAME, ros_type.replace("/srv/", "/msg/")
    contents = [drawn(field, chance) for _ in range(CASES)]
    return [(one, expected_of(ros_type, one)) for one in contents]


@pytest.mark.parametrize("ros_type", FIELDS)
def test_the_types_that_dds_is_told_have_the_definitions_layout(ros_type: str):
    kind = typed(ros_type)
    for content, expected in cases(ros_type):
        sample = for_dds(kind, content)
        assert sample.serialize(use_version_2=False) == expected
        assert kind.deserialize(expected).serialize(use_version_2=False) == expected


@pytest.mark.parametrize("ros_type", FIELDS)
def test_bytes_pass_unchanged(ros_type: str):
    for _, expected in cases(ros_type)[:5]:
        sample = TYPES[ros_type].deserialize(expected)
        assert body_of(sample) == expected
        assert sample.serialize() == expected


# What the gateway writes and reads by its own code, beside the definitions.


def header_of(content: dict[str, Any]) -> Header:
    """The content's header, with a stamp that is one: ROS's seconds are not negative."""
    stamp = content["header"]["stamp"]
    stamp["sec"], stamp["nanosec"] = abs(stamp["sec"] // 2), stamp["nanosec"] % 10**9
    return Header(Stamp(stamp["sec"], stamp["nanosec"]), content["header"]["frame_id"])


def pose_of(content: dict[str, Any]) -> np.ndarray:
    """The content's pose as a matrix; its quaternion becomes the one that is written for the matrix."""
    names = ("translation", "rotation") if "rotation" in content else ("position", "orientation")
    place, turn = (content[name] for name in names)
    T = from_quaternion([*place.values()], [*turn.values()])
    turn.update(zip("xyzw", map(float, quaternion_of(T)), strict=True))
    return T


def test_poses_are_written_as_defined():
    ros_type = "geometry_msgs/msg/PoseWithCovarianceStamped"
    for content, _ in cases(ros_type):
        header, T = header_of(content), pose_of(content["pose"]["pose"])
        covariance = np.array(content["pose"]["covariance"]).reshape(6, 6)
        answer = Localization(Verdict.LOCALIZED, (), T, None, covariance, 0.9)
        body = to_pose_cdr(answer, header.stamp, header.frame_id)
        assert body == expected_of(ros_type, content)
        read = decode_own_pose(body)
        assert read.header == header
        assert np.allclose(read.T_map_base, T)


def test_arrays_of_poses_are_written_as_defined():
    for content, _ in cases("geometry_msgs/msg/PoseArray"):
        header, poses = header_of(content), [pose_of(one) for one in content["poses"]]
        assert encode_pose_array(header, poses) == expected_of("geometry_msgs/msg/PoseArray", content)


def test_transforms_are_written_and_read_as_defined():
    for content, _ in cases("tf2_msgs/msg/TFMessage"):
        transforms = [
            (header_of(one), one["child_frame_id"], pose_of(one["transform"]))
            for one in content["transforms"]
        ]
        body = encode_tf(transforms)
        assert body == expected_of("tf2_msgs/msg/TFMessage", content)
        for read, (header, child, T) in zip(decode_tf(body), transforms, strict=True):
            assert read.stamp == header.stamp
            assert (read.parent, read.child) == (header.frame_id.removeprefix("/"), child.removeprefix("/"))
            assert np.allclose(read.T_parent_child, T)


def test_diagnoses_are_written_as_defined():
    ros_type = "diagnostic_msgs/msg/DiagnosticArray"
    for content, _ in cases(ros_type):
        header = header_of(content)
        for number, one in enumerate(content["status"]):
            for place, value in enumerate(one["values"]):
                value["key"] += f"{number}{place}"  # keys of a diagnosis differ
        diagnoses = [
            Diagnosis(
                one["level"],
                one["name"],
                one["message"],
                one["hardware_id"],
                {value["key"]: value["value"] for value in one["values"]},
            )
            for one in content["status"]
        ]
        assert encode_diagnostic_array(header, diagnoses) == expected_of(ros_type, content)


def test_imu_samples_are_read_as_defined():
    for content, _ in cases("sensor_msgs/msg/Imu"):
        header = header_of(content)
        read = decode_imu(expected_of("sensor_msgs/msg/Imu", content))
        assert read.header == header
        assert [*read.acceleration] == [*content["linear_acceleration"].values()]


def test_requests_and_replies_are_read_and_written_as_defined():
    for content, expected in cases("std_srvs/srv/Trigger_Response"):
        content["success"] = True
        reply = trigger_reply((content["client"], content["number"]), content["message"])
        assert reply == expected_of("std_srvs/srv/Trigger_Response", content)
        header = expected[4:20]
        request = expected[:4] + header + b"\x07"
        assert request_header(request) == (content["client"], content["number"])
    for _, expected in cases("std_srvs/srv/Trigger_Request"):
        assert request_header(expected) is None
