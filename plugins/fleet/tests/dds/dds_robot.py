"""A robot on DDS, as a program of its own: publishes what a driver publishes, and tells what it hears.

It takes commands as JSON lines, and writes what it hears as JSON lines. Bytes are rosbags', not ours.
"""

from __future__ import annotations

import itertools
import json
import queue
import sys
import threading
import time
from typing import Any

import numpy as np
from cyclonedds.core import Policy, Qos
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration
from rosbags.typesys import get_types_from_msg

from firstfix.transform import make_transform, rotation_z
from firstfix_fleet.dds.messages import TYPES, body_of, sample_of
from tests import ros_samples
from tests.live_clouds import TYPE_OF, live_cloud
from tests.ros_samples import ROS2, cdr

POSE, TF = "geometry_msgs/msg/PoseWithCovarianceStamped", "tf2_msgs/msg/TFMessage"
RESPONSE = "std_srvs/msg/Trigger_Response"
ROS2.register(get_types_from_msg("bool success\nstring message", RESPONSE))
HEARD = {
    "initialpose": POSE,
    "first_fix/pose": POSE,
    "first_fix/status": "diagnostic_msgs/msg/DiagnosticArray",
    "first_fix/hypotheses": "geometry_msgs/msg/PoseArray",
    "tf": TF,
}
RELIABLE = Policy.Reliability.Reliable(duration(seconds=1))
HEADER = (0x1122334455667788).to_bytes(8, "little")
T_ODOM_BASE = make_transform(rotation_z(0.7), [2.0, -1.0, 0.0])
T_BASE_LIDAR = make_transform(rotation_z(0.3), [0.1, 0.0, 0.4])


class Robot:
    """One robot."""

    def __init__(
        self, domain: int, config: str, namespace: str, best_effort: bool, form: str = "plain"
    ) -> None:
        self.namespace = namespace
        self.domain = Domain(domain, config)
        self.participant = DomainParticipant(domain)
        sensor = Policy.Reliability.BestEffort if best_effort else RELIABLE
        self.clouds = self.writer("rt", "points", TYPE_OF[form], sensor, 5)
        self.form = form
        self.imu = self.writer("rt", "imu", "sensor_msgs/msg/Imu", sensor, 5)
        self.tf = self.writer("rt", "tf", TF, RELIABLE, 100)
        self.fixed = self.writer("rt", "tf_static", TF, RELIABLE, 1, Policy.Durability.TransientLocal)
        self.requests = self.writer("rq", "first_fix/relocalizeRequest", "std_srvs/srv/Trigger_Request")
        self.replies = self.reader("rr", "first_fix/relocalizeReply", "std_srvs/srv/Trigger_Response")
        self.heard = {name: (self.reader("rt", name, ros_type), ros_type) for name, ros_type in HEARD.items()}
        frames = [("base_link", "lidar", T_BASE_LIDAR), ("lidar", "imu_link", np.eye(4))]
        self.write(self.fixed, cdr(ros_samples.transforms(frames)))
        self.points: Any = None
        self.broken = False
        self._numbers = itertools.count(1)

    def writer(
        self, prefix: str, name: str, ros_type: str, reliability: Any = RELIABLE, depth: int = 10, *more: Any
    ) -> Any:
        topic = Topic(self.participant, f"{prefix}{self.namespace}/{name}", TYPES[ros_type])
        return DataWriter(self.participant, topic, Qos(reliability, Policy.History.KeepLast(depth), *more))

    def reader(self, prefix: str, name: str, ros_type: str) -> Any:
        topic = Topic(self.participant, f"{prefix}{self.namespace}/{name}", TYPES[ros_type])
        return DataReader(self.participant, topic, Qos(RELIABLE, Policy.History.KeepLast(100)))

    def write(self, writer: Any, body: bytes) -> None:
        writer.write(sample_of(writer.data_type, body))

    def call(self, header: bool) -> None:
        """Calls the service as rmw_cyclonedds does, or, without a header, as rmw_fastrtps does."""
        number = next(self._numbers).to_bytes(8, "little")
        self.write(self.requests, b"\0\1\0\0" + ((HEADER + number) if header else b"") + b"\0")

    def obey(self, command: dict[str, Any]) -> None:
        """Takes new points, or calls the service."""
        if "points" in command:
            self.points = np.load(command["points"])
        if "broken" in command:
            self.broken = command["broken"]
        if "call" in command:
            self.call(command["call"])

    def turn(self) -> None:
        """Publishes one round, and tells what came."""
        now_ns = time.time_ns()
        gravity = [0, 0, 9.81]
        self.write(self.imu, cdr(ros_samples.imu(gravity, stamp_ns=now_ns, frame_id="imu_link")))
        odometry = ros_samples.transforms([("odom", "base_link", T_ODOM_BASE)])
        odometry.transforms[0].header.stamp.sec, odometry.transforms[0].header.stamp.nanosec = divmod(
            now_ns, 10**9
        )
        self.write(self.tf, cdr(odometry))
        if self.points is not None:
            body = live_cloud(self.form, self.points, now_ns, "lidar")
            if self.broken:  # Cyclone DDS sends only well-formed bytes
                cloud = ros_samples.cloud_of_points(self.points, stamp_ns=now_ns, point_step=5)
                body = cdr(cloud)
            self.write(self.clouds, body)
        for name, (reader, ros_type) in self.heard.items():
            for sample in reader.take(100):
                if body_of(sample) is not None:
                    tell(topic=name, **fields(ROS2.deserialize_cdr(sample.body, ros_type)))
        for sample in self.replies.take(100):
            if body_of(sample) is not None:
                header, body = sample.body[4:20], sample.body[:4] + sample.body[20:]
                reply = ROS2.deserialize_cdr(body, RESPONSE)
                number = int.from_bytes(header[8:], "little")
                tell(topic="reply", mine=header[:8] == HEADER, number=number, message=reply.message)


def fields(message: Any) -> dict[str, Any]:
    """The fields that the tests look at."""
    kind = message.__msgtype__.rpartition("/")[2]
    if kind == "TFMessage":
        return {
            "frames": [
                [t.header.frame_id, t.child_frame_id, *numbers(t.transform)] for t in message.transforms
            ]
        }
    if kind == "DiagnosticArray":
        (one,) = message.status
        return {
            "level": int(one.level),
            "message": one.message,
            "hardware_id": one.hardware_id,
            "values": {v.key: v.value for v in one.values},
        }
    stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
    if kind == "PoseArray":
        return {
            "frame": message.header.frame_id,
            "stamp": stamp,
            "poses": [list(numbers(p)) for p in message.poses],
        }
    pose = message.pose
    return {
        "frame": message.header.frame_id,
        "stamp": stamp,
        "pose": list(numbers(pose.pose)),
        "covariance": [float(v) for v in pose.covariance],
    }


def numbers(pose: Any) -> tuple[float, ...]:
    p, q = (
        (pose.translation, pose.rotation)
        if hasattr(pose, "translation")
        else (pose.position, pose.orientation)
    )
    return p.x, p.y, p.z, q.x, q.y, q.z, q.w


def tell(**values: Any) -> None:
    print(json.dumps(values), flush=True)


def main() -> None:
    """Plays the robot until the standard input ends."""
    robot = Robot(**json.loads(sys.argv[1]))
    commands: queue.SimpleQueue[dict[str, Any] | None] = queue.SimpleQueue()

    def listen() -> None:
        for line in sys.stdin:
            commands.put(json.loads(line))
        commands.put(None)

    threading.Thread(target=listen, daemon=True).start()
    while True:
        try:
            command = commands.get(timeout=0.1)
        except queue.Empty:
            robot.turn()
            continue
        if command is None:
            return
        robot.obey(command)


if __name__ == "__main__":
    main()
