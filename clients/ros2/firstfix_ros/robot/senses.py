"""The newest messages of a robot: IMU, frames, odometry, and the pose of its own localization."""

from __future__ import annotations

import threading
from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from firstfix.ros.header import Header, Stamp
from firstfix.ros.imu import GravityWindow, decode_imu
from firstfix.ros.tf_message import StampedTransform, decode_tf, plain
from firstfix.transform import Matrix, inverse

from ..messages.own_pose import OwnPose, decode_own_pose
from .topics import Input
from .transform_tree import HOLD_S, TransformTree

DATED_AHEAD_S = 1.5  # localizers date map -> odom ahead, so that it is valid until the next one: AMCL by 1 s


@dataclass(frozen=True)
class OwnLocalization:
    """Pose (4, 4) of a frame of the robot by its own localization.

    Attributes:
        planar: it knows no height and no tilt.
    """

    T_map_frame: Matrix
    planar: bool


class Senses:
    """The newest messages of one robot, decoded. Thread-safe, bounded in memory.

    Args:
        map_frame, odom_frame, base_frame: as in ``GatewayConfig``.
    """

    def __init__(self, map_frame: str, odom_frame: str, base_frame: str) -> None:
        self._map, self._odom, self._base = plain(map_frame), plain(odom_frame), base_frame
        self._lock = threading.Lock()
        self._window = GravityWindow()
        self._tree = TransformTree()
        self._own_pose: OwnPose | None = None
        self._published: deque[tuple[int, tuple[float, ...]]] = deque(maxlen=100)
        self.others_publish_map = False  # somebody else publishes a transform from the map's frame

    def take(self, kind: Input, body: bytes | memoryview) -> None:
        """Take a message.

        Raises:
            MalformedData, UnsupportedFormat: the bytes are not such a message.
        """
        if kind is Input.IMU:
            sample = decode_imu(body)
            with self._lock:
                self._window.add(sample)
        elif kind is Input.TF_STATIC:
            fixed = decode_tf(body)
            with self._lock:
                self._tree.add_fixed(fixed)
        elif kind is Input.TF:
            moving = decode_tf(body)
            with self._lock:
                others = [one for one in moving if not self._is_ours(one)]
                self.others_publish_map |= any(one.parent == self._map for one in others)
                self._tree.add_moving(others)
        elif kind is Input.OWN_POSE:
            pose = decode_own_pose(body)
            with self._lock:
                self._own_pose = pose

    def remember_published(self, transform: StampedTransform) -> None:
        """Note a transform that the gateway publishes, so that it is not taken for another's."""
        with self._lock:
            self._published.append((transform.stamp.ns, transform.numbers))

    def between(self, target: str, source: str, at: Stamp) -> Matrix | None:
        """``T_target_source`` at a time; None if it is not known."""
        with self._lock:
            return self._tree.between(target, source, at)

    def odometry(self, frame: str, at: Stamp) -> Matrix | None:
        """The pose (4, 4) of a frame of the robot in the odometry's frame."""
        return self.between(self._odom, frame, at)

    def odometry_stamp(self) -> Stamp | None:
        """The time of the last odometry."""
        with self._lock:
            newest = self._tree.newest_below(self._odom)
        return None if newest is None else newest.stamp

    def odometry_stamps(self, after: Stamp) -> list[Stamp]:
        """The times of the odometry after a time, oldest first, as far as they are kept."""
        with self._lock:
            return self._tree.stamps_below(self._odom, after)

    def newest_stamp(self) -> Stamp | None:
        """The time of the last odometry; without odometry of the robot's own localization."""
        with self._lock:
            link = self._tree.newest_below(self._odom) or self._tree.newest_below(self._map)
            pose = self._own_pose
        if link is not None:
            return link.stamp
        return None if pose is None else pose.header.stamp

    def gravity(self, header: Header) -> NDArray[np.float64] | None:
        """The (3,) direction of gravity in the frame of a cloud; None if not known."""
        with self._lock:
            down, frame = self._window.down(header.stamp), self._window.frame_id
        if down is None or frame == header.frame_id:
            return down
        T_sensor_imu = self.between(header.frame_id, frame, header.stamp)
        return None if T_sensor_imu is None else T_sensor_imu[:3, :3] @ down

    def own_localization(self, frame: str, at: Stamp) -> OwnLocalization | None:
        """The pose of a frame of the robot, by the robot's own localization, at a time."""
        with self._lock:
            pose, link = self._own_pose, self._tree.newest_below(self._map)
        if pose is not None and plain(pose.header.frame_id) == self._map:
            return self._carried(pose, frame, at)
        if link is None:
            return None
        T = self.between(self._map, frame, at)
        if T is None and link.child == self._odom and 0 <= link.stamp.ns - at.ns <= DATED_AHEAD_S * 1e9:
            T_odom_frame = self.odometry(frame, at)
            T = None if T_odom_frame is None else link.T_parent_child @ T_odom_frame
        return None if T is None else OwnLocalization(T, _is_planar(link.T_parent_child))

    def _carried(self, pose: OwnPose, frame: str, at: Stamp) -> OwnLocalization | None:
        """Bring a pose of the base to another time and frame."""
        base = self._base or frame
        T_base_frame = self.between(base, frame, at)
        if T_base_frame is None:
            return None
        T_map_base = pose.T_map_base
        then, now = self.odometry(base, pose.header.stamp), self.odometry(base, at)
        if then is not None and now is not None:
            T_map_base = T_map_base @ inverse(then) @ now
        elif at.ns and abs(at.ns - pose.header.stamp.ns) > HOLD_S * 1e9:
            return None
        return OwnLocalization(T_map_base @ T_base_frame, _is_planar(pose.T_map_base))

    def _is_ours(self, one: StampedTransform) -> bool:
        return one.parent == self._map and (one.stamp.ns, one.numbers) in self._published


def _is_planar(T: Matrix) -> bool:
    """Whether a pose has neither height nor tilt, as those of a localization in the plane."""
    return abs(T[2, 3]) < 1e-9 and T[2, 2] > 1 - 1e-12
