"""A robot with a gateway of its own, whose clock the benchmark moves on."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from rosbags.typesys import Stores, get_typestore

from firstfix.ros.header import Header, Stamp
from firstfix.ros.tf_message import encode_tf
from firstfix.transform import Matrix, inverse, make_transform, rotation_z
from firstfix_ros.robot.answerer import Answerer
from firstfix_ros.robot.config import GatewayConfig
from firstfix_ros.robot.gateway import RobotGateway
from firstfix_ros.robot.topics import Input
from firstfix_ros.robot.watch import Health

CLOUD_EVERY_S = 0.1
SENSOR, ODOM, MAP = "lidar", "odom", "map"
START_NS = 1_700_000_000 * 10**9
KEPT, NOISE_M = (0.5, 1.0), 0.01  # of a scan's points
OWN_ERROR_M, OWN_ERROR_DEG = 0.1, 1.0  # of the robot's own localization, standard deviations
_ROS = get_typestore(Stores.ROS2_HUMBLE)
_CLOUD = "sensor_msgs/msg/PointCloud2"


class Clock:
    """Seconds that pass when the benchmark says so, and while queries are answered."""

    def __init__(self) -> None:
        self._s = 0.0

    def __call__(self) -> float:
        """Returns the seconds since the start."""
        return self._s

    def pass_by(self, seconds: float) -> None:
        """Moves the clock on."""
        self._s += seconds

    @property
    def stamp(self) -> Stamp:
        """The time as ROS has it."""
        return Stamp.of_ns(START_NS + round(self._s * 1e9))


@dataclass(frozen=True)
class Scene:
    """View of a robot at a place.

    Attributes:
        points: (n, 3) in the sensor's frame.
        T_map_sensor: true pose.
        error: (4, 4) of the robot's own localization, in the map: ``T_map_own = error @ T_map_sensor``.
        phase: of the time between two checks, at which the robot is moved.
    """

    points: NDArray[np.float32]
    T_map_sensor: Matrix
    error: Matrix
    phase: float

    @classmethod
    def of(cls, points: NDArray[np.float64], T_map_sensor: Matrix, chance: np.random.Generator) -> Scene:
        """Makes a scene from a scan: turned about the sensor's axis, thinned and noisy."""
        turn = make_transform(rotation_z(chance.uniform(-np.pi, np.pi)), [0.0, 0.0, 0.0])
        kept = points[chance.random(len(points)) < chance.uniform(*KEPT)]
        noisy = kept @ turn[:3, :3] + chance.normal(0.0, NOISE_M, kept.shape)
        angle = np.radians(chance.normal(0.0, OWN_ERROR_DEG))
        x, y = chance.normal(0.0, OWN_ERROR_M, 2)
        place = T_map_sensor[:3, 3]
        about = make_transform(rotation_z(angle), place - rotation_z(angle) @ place + [x, y, 0.0])
        return cls(noisy.astype(np.float32), T_map_sensor @ turn, about, chance.random())


def move(distance_m: float, chance: np.random.Generator) -> Matrix:
    """Returns a move over the floor, in a direction by chance."""
    angle = chance.uniform(-np.pi, np.pi)
    return make_transform(np.eye(3), [distance_m * np.cos(angle), distance_m * np.sin(angle), 0.0])


class WatchedRobot:
    """A robot whose gateway watches.

    Attributes:
        error: of its own localization, as in ``Scene``.
    """

    def __init__(self, ask: Answerer, clock: Clock, watch_s: float) -> None:
        self.clock, self.watch_s, self.error = clock, watch_s, np.eye(4)
        self._ask = ask
        self.restart()

    def restart(self) -> None:
        """Forgets all that was seen."""
        config = GatewayConfig(at_start=False, watch_s=self.watch_s, publishes_tf=False)
        self._gateway = RobotGateway(
            self._ask, lambda kind, body: None, config, clock=self.clock, wall_ns=lambda: self.clock.stamp.ns
        )

    @property
    def health(self) -> Health:
        """Health of its own localization, as its watch sees it."""
        health = self._gateway.status.health
        assert health is not None
        return health

    def cloud(self, scene: Scene) -> bool:
        """Gives one cloud with the transforms of its time. Returns whether it was checked."""
        self.clock.pass_by(CLOUD_EVERY_S)
        stamp = self.clock.stamp
        own = self.error @ scene.T_map_sensor
        # Odometry is right but for its origin: the error is in what the robot's localization adds.
        transforms = [
            (Header(stamp, MAP), ODOM, own @ inverse(scene.T_map_sensor)),
            (Header(stamp, ODOM), SENSOR, scene.T_map_sensor),
        ]
        self._gateway.take(Input.TF, encode_tf(transforms))
        self._gateway.take(Input.CLOUD, _encoded(scene.points, stamp))
        begin_s = time.perf_counter()
        was_checked = self._gateway.step()
        self.clock.pass_by(time.perf_counter() - begin_s)
        return was_checked

    def checked(self, scene: Scene) -> Health:
        """Gives clouds until one is checked, and returns the health after it."""
        while not self.cloud(scene):
            pass
        return self.health


def _encoded(points: NDArray[np.float32], stamp: Stamp) -> bytes:
    types = _ROS.types
    time_of = types["builtin_interfaces/msg/Time"](stamp.sec, stamp.nanosec)
    field = types["sensor_msgs/msg/PointField"]
    cloud = types[_CLOUD](
        header=types["std_msgs/msg/Header"](stamp=time_of, frame_id=SENSOR),
        height=1,
        width=len(points),
        fields=[field(name, 4 * place, 7, 1) for place, name in enumerate("xyz")],
        is_bigendian=False,
        point_step=12,
        row_step=12 * len(points),
        data=np.frombuffer(points.tobytes(), np.uint8),
        is_dense=True,
    )
    return bytes(_ROS.serialize_cdr(cloud, _CLOUD))
