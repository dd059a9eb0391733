"""ROS 2's message types as DDS knows them. Samples pass as serialised bytes: nothing is converted twice.

The fields of a type are told to DDS for its type information alone. Names follow rosidl's IDL for DDS.
"""

from __future__ import annotations

from typing import Any

from cyclonedds.idl import IdlStruct, make_idl_struct
from cyclonedds.idl.types import array, float32, float64, int32, int64, sequence, uint8, uint32, uint64

from firstfix.ros.rmw_zenoh import dds_type
from firstfix_ros.robot.cloud_types import COMPRESSED, LIVOX

Fields = dict[str, Any]


def _struct(ros_type: str, fields: Fields) -> type[IdlStruct]:
    name = dds_type(ros_type)
    return make_idl_struct(name.rpartition("::")[2], name, fields)


Time = _struct("builtin_interfaces/msg/Time", {"sec": int32, "nanosec": uint32})
Header = _struct("std_msgs/msg/Header", {"stamp": Time, "frame_id": str})
Vector3 = _struct("geometry_msgs/msg/Vector3", {"x": float64, "y": float64, "z": float64})
Point = _struct("geometry_msgs/msg/Point", {"x": float64, "y": float64, "z": float64})
Quaternion = _struct("geometry_msgs/msg/Quaternion", {"x": float64, "y": float64, "z": float64, "w": float64})
Pose = _struct("geometry_msgs/msg/Pose", {"position": Point, "orientation": Quaternion})
PoseWithCovariance = _struct(
    "geometry_msgs/msg/PoseWithCovariance", {"pose": Pose, "covariance": array[float64, 36]}
)
Transform = _struct("geometry_msgs/msg/Transform", {"translation": Vector3, "rotation": Quaternion})
TransformStamped = _struct(
    "geometry_msgs/msg/TransformStamped",
    {"header": Header, "child_frame_id": str, "transform": Transform},
)
PointField = _struct(
    "sensor_msgs/msg/PointField", {"name": str, "offset": uint32, "datatype": uint8, "count": uint32}
)
KeyValue = _struct("diagnostic_msgs/msg/KeyValue", {"key": str, "value": str})
DiagnosticStatus = _struct(
    "diagnostic_msgs/msg/DiagnosticStatus",
    {"level": uint8, "name": str, "message": str, "hardware_id": str, "values": sequence[KeyValue]},
)

_CLOUD_HEAD: Fields = {
    "header": Header,
    "height": uint32,
    "width": uint32,
    "fields": sequence[PointField],
    "is_bigendian": bool,
    "point_step": uint32,
    "row_step": uint32,
}


def _livox(package: str) -> Fields:
    point = {"offset_time": uint32, **dict.fromkeys("xyz", float32)}
    point |= dict.fromkeys(("reflectivity", "tag", "line"), uint8)
    return {
        "header": Header,
        "timebase": uint64,
        "point_num": uint32,
        "lidar_id": uint8,
        "rsvd": array[uint8, 3],
        "points": sequence[_struct(f"{package}/msg/CustomPoint", point)],
    }


FIELDS: dict[str, Fields] = {
    "sensor_msgs/msg/PointCloud2": {
        **_CLOUD_HEAD,
        "data": sequence[uint8],
        "is_dense": bool,
    },
    COMPRESSED: {**_CLOUD_HEAD, "compressed_data": sequence[uint8], "is_dense": bool, "format": str},
    **{ros_type: _livox(ros_type.partition("/")[0]) for ros_type in LIVOX},
    "sensor_msgs/msg/Imu": {
        "header": Header,
        "orientation": Quaternion,
        "orientation_covariance": array[float64, 9],
        "angular_velocity": Vector3,
        "angular_velocity_covariance": array[float64, 9],
        "linear_acceleration": Vector3,
        "linear_acceleration_covariance": array[float64, 9],
    },
    "tf2_msgs/msg/TFMessage": {"transforms": sequence[TransformStamped]},
    "geometry_msgs/msg/PoseWithCovarianceStamped": {"header": Header, "pose": PoseWithCovariance},
    "geometry_msgs/msg/PoseArray": {"header": Header, "poses": sequence[Pose]},
    "diagnostic_msgs/msg/DiagnosticArray": {"header": Header, "status": sequence[DiagnosticStatus]},
    "std_srvs/srv/Trigger_Request": {"structure_needs_at_least_one_member": uint8},
    # Cyclone DDS compares what it writes with the type: so with the header of rmw_cyclonedds.
    "std_srvs/srv/Trigger_Response": {"client": uint64, "number": int64, "success": bool, "message": str},
}


def sample_of(kind: type[IdlStruct], body: bytes) -> Any:
    """Make a sample of a type of ``TYPES`` from a message in CDR with its encapsulation."""
    made: Any = object.__new__(kind)
    made.body = body
    return made


def body_of(sample: Any) -> bytes | None:
    """The message in CDR; None if the sample only says that a publisher went."""
    body: bytes | None = getattr(sample, "body", None)
    return body


def _passing(ros_type: str) -> type[IdlStruct]:
    """The type whose samples cyclonedds passes on as bytes."""
    made: Any = _struct(ros_type, FIELDS[ros_type])
    # Not in a base class: cyclonedds takes each base for an IDL type.
    made.serialize = lambda self, *args, **options: self.body
    made.deserialize = classmethod(lambda kind, data, *args, **options: sample_of(kind, data))
    return made


TYPES: dict[str, type[IdlStruct]] = {ros_type: _passing(ros_type) for ros_type in FIELDS}
