"""Robots on a real ROS 2, as a program of their own: rclpy alone, nothing of firstfix.

It takes commands as lines of JSON, and tells what its robots hear as lines of JSON. Each line names its robot
by the namespace. The commands are the methods of ``Robot``.
"""

from __future__ import annotations

import array
import json
import queue
import sys
import threading
import time
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseArray, PoseWithCovarianceStamped, TransformStamped
from livox_ros_driver2.msg import CustomMsg, CustomPoint
from point_cloud_interfaces.msg import CompressedPointCloud2
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy, qos_profile_sensor_data
from rclpy.time import Time
from sensor_msgs.msg import Imu, PointCloud2, PointField
from std_srvs.srv import Trigger
from tf2_msgs.msg import TFMessage

HEARD = {
    "initialpose": PoseWithCovarianceStamped,
    "first_fix/pose": PoseWithCovarianceStamped,
    "first_fix/status": DiagnosticArray,
    "first_fix/hypotheses": PoseArray,
}
FIELDS = [PointField(name=name, offset=4 * i, datatype=7, count=1) for i, name in enumerate(("x", "y", "z"))]


@dataclass(frozen=True)
class Form:
    """A form of clouds: the type of its messages, and what makes one of a PointCloud2."""

    kind: Any
    made: Callable[[PointCloud2], Any]


def zlib_of(cloud: PointCloud2) -> CompressedPointCloud2:
    made = CompressedPointCloud2(format="zlib", is_dense=cloud.is_dense)
    for name in ("header", "height", "width", "fields", "is_bigendian", "point_step", "row_step"):
        setattr(made, name, getattr(cloud, name))
    made.compressed_data = array.array("B", zlib.compress(cloud.data.tobytes()))
    return made


def livox_of(cloud: PointCloud2) -> CustomMsg:
    rows = np.frombuffer(cloud.data, np.uint8).reshape(-1, cloud.point_step)[:, :12].copy().view("<f4")
    points = [CustomPoint(x=float(x), y=float(y), z=float(z)) for x, y, z in rows]
    return CustomMsg(header=cloud.header, point_num=len(points), points=points)


FORMS = {
    "plain": Form(PointCloud2, lambda cloud: cloud),
    "zlib": Form(CompressedPointCloud2, zlib_of),
    "livox": Form(CustomMsg, livox_of),
}


class Robot(Node):
    """One robot: publishes what a driver publishes, and tells what it hears.

    Args:
        odometry: numbers of the transform from odom to base_link; None: not published.
        fixed: frames that it publishes at once.
        points: topic of its clouds.
        tf: topic of the moving frames; that of the fixed ones is ``<tf>_static``.
        late_s: its clock is late by so much.
        every_s: between two rounds of messages.
        point_step: bytes of a point; x, y and z are its first twelve.
        rows: of the cloud.
        form: of its clouds: plain, zlib or livox.
    """

    def __init__(
        self,
        namespace: str,
        *,
        points: str = "points",
        reliable: bool = False,
        odometry: list[float] | None = None,
        fixed: list[dict[str, Any]] = (),  # type: ignore[assignment]
        tf: str = "tf",
        late_s: float = 0.0,
        every_s: float = 0.1,
        point_step: int = 16,
        rows: int = 1,
        form: str = "plain",
    ) -> None:
        super().__init__("robot", namespace=namespace)
        self._name, self._late_ns, self._odometry = namespace, int(late_s * 1e9), odometry
        self._point_step, self._rows = point_step, rows
        reliability = ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT
        self._form = FORMS[form]
        self._clouds = self.create_publisher(
            self._form.kind, points, QoSProfile(depth=5, reliability=reliability)
        )
        self._samples = self.create_publisher(Imu, "imu", qos_profile_sensor_data)
        self._tf = self.create_publisher(TFMessage, tf, 100)
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._fixed = self.create_publisher(TFMessage, f"{tf}_static", latched)
        self._own_poses = self.create_publisher(
            PoseWithCovarianceStamped, "own_pose", qos_profile_sensor_data
        )
        for topic, kind in HEARD.items():
            self.create_subscription(kind, topic, partial(self._hear, topic), 100)
        self.create_subscription(TFMessage, tf, self._hear_tf, 100)
        self._client = self.create_client(Trigger, "first_fix/relocalize")
        self._cloud: PointCloud2 | None = None
        self._sample, self._own_pose, self._map_to_odom = Imu(), None, None
        self._found_service, self._calls = False, []
        if fixed:
            self.fix(fixed)
        self.create_timer(every_s, self._publish)

    def fix(self, frames: list[dict[str, Any]]) -> None:
        """Publishes fixed frames."""
        self._fixed.publish(TFMessage(transforms=[self._transform(**frame) for frame in frames]))

    def show(
        self, points: str, acceleration: list[float], point_step: int | None = None, count: int | None = None
    ) -> None:
        """Takes what its sensors see from now on: a file of x, y, z, intensity as float32.

        Args:
            point_step: that the message says, in the place of the right one.
            count: of the points; they are repeated.
        """
        rows = np.fromfile(points, "<f4").reshape(-1, 4)
        if count is not None:
            rows = np.resize(rows, (count, 4))
        body = np.zeros((len(rows), self._point_step), np.uint8)
        body[:, :12] = rows[:, :3].copy().view(np.uint8).reshape(-1, 12)
        cloud = PointCloud2(height=self._rows, width=len(rows) // self._rows, fields=FIELDS, is_dense=True)
        cloud.point_step = self._point_step if point_step is None else point_step
        cloud.row_step = cloud.width * self._point_step
        cloud.data = array.array("B", body[: cloud.height * cloud.width].tobytes())
        cloud.header.frame_id = "os_sensor"
        self._cloud = cloud
        self._sample = Imu()
        self._sample.header.frame_id = "imu_link"
        a = self._sample.linear_acceleration
        a.x, a.y, a.z = acceleration

    def hide(self) -> None:
        """Publishes no clouds from now on."""
        self._cloud = None

    def call(self, number: int) -> None:
        """Calls the service as soon as it is found."""
        self._calls.append(number)

    def localize(self, map_to_odom: list[float] | None = None, own_pose: list[float] | None = None) -> None:
        """Publishes its own localization from now on: a transform, or poses of the base."""
        self._map_to_odom, self._own_pose = map_to_odom, own_pose

    def _publish(self) -> None:
        stamp = Time(nanoseconds=time.time_ns() - self._late_ns).to_msg()
        transforms = []
        if self._odometry is not None:
            transforms.append(
                self._transform("odom", "base_link", self._odometry[:3], self._odometry[3:], stamp)
            )
        if self._map_to_odom is not None:
            numbers = self._map_to_odom
            transforms.append(self._transform("map", "odom", numbers[:3], numbers[3:], stamp))
        if transforms:
            self._tf.publish(TFMessage(transforms=transforms))
        if self._own_pose is not None:
            message = PoseWithCovarianceStamped()
            message.header.frame_id, message.header.stamp = "map", stamp
            set_pose(message.pose.pose.position, message.pose.pose.orientation, self._own_pose)
            self._own_poses.publish(message)
        if self._cloud is not None:
            self._sample.header.stamp = self._cloud.header.stamp = stamp
            self._samples.publish(self._sample)
            self._clouds.publish(self._form.made(self._cloud))
        self._ask()

    def _ask(self) -> None:
        if self._client.service_is_ready():
            if not self._found_service:
                self._found_service = True
                tell(self._name, "service")
            while self._calls:
                number = self._calls.pop(0)
                self._client.call_async(Trigger.Request()).add_done_callback(partial(self._answered, number))

    def _answered(self, number: int, future: Any) -> None:
        tell(self._name, "response", call=number, message=fields(future.result()))

    def _hear(self, topic: str, message: Any) -> None:
        tell(self._name, topic, message=fields(message))

    def _hear_tf(self, message: TFMessage) -> None:
        for one in message.transforms:
            if one.header.frame_id == "map":
                tell(self._name, "tf", message=fields(one))

    def _transform(
        self, parent: str, child: str, translation: list[float], rotation: list[float], stamp: Any = None
    ) -> TransformStamped:
        made = TransformStamped(child_frame_id=child)
        made.header.frame_id = parent
        if stamp is not None:
            made.header.stamp = stamp
        set_pose(made.transform.translation, made.transform.rotation, [*translation, *rotation])
        return made


def set_pose(position: Any, turn: Any, numbers: list[float]) -> None:
    position.x, position.y, position.z, turn.x, turn.y, turn.z, turn.w = numbers


def fields(message: Any) -> Any:
    """A message as JSON can tell it."""
    if hasattr(message, "get_fields_and_field_types"):
        return {name: fields(getattr(message, name)) for name in message.get_fields_and_field_types()}
    if isinstance(message, bytes):  # a byte of ROS
        return message[0]
    if isinstance(message, (list, tuple, array.array, np.ndarray)):
        return [fields(one) for one in message]
    return message.item() if isinstance(message, np.generic) else message


def tell(robot: str, event: str, **values: Any) -> None:
    print(json.dumps({"robot": robot, "event": event, **values}), flush=True)


def main() -> None:
    """Plays the robots until the standard input ends."""
    commands: queue.SimpleQueue[dict[str, Any] | None] = queue.SimpleQueue()

    def listen() -> None:
        for line in sys.stdin:
            commands.put(json.loads(line))
        commands.put(None)

    threading.Thread(target=listen, daemon=True).start()
    rclpy.init()
    executor = SingleThreadedExecutor()
    robots: dict[str, Robot] = {}
    while True:
        executor.spin_once(timeout_sec=0.02)
        if commands.empty():
            continue
        command = commands.get()
        if command is None:
            break
        name = command.pop("robot")
        for what, values in command.items():
            if what == "come":
                robots[name] = Robot(name, **values)
                executor.add_node(robots[name])
            elif what == "go":
                executor.remove_node(robots[name])
                robots.pop(name).destroy_node()
            else:
                method = getattr(robots[name], what)
                method(**values) if isinstance(values, dict) else method(values)
    rclpy.shutdown()


if __name__ == "__main__":
    main()
