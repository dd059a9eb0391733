"""Robots of the tests as programs: steered by lines of JSON, and heard by lines of JSON."""

from __future__ import annotations

import json
import subprocess
import threading
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from firstfix.scan.scan import Scan
from firstfix.transform import Matrix, from_quaternion, quaternion_of
from tests.waiting import LIMIT_S, wait_until

GRAVITY_M_S2 = 9.81
BASE, SENSOR, IMU = "base_link", "os_sensor", "imu_link"
# Not square, so that a frame that is taken for another shows.
T_BASE_SENSOR = from_quaternion([0.2, -0.1, 0.6], [0.0, 0.0, 0.6, 0.8])
T_SENSOR_IMU = from_quaternion([0.0, 0.0, 0.05], [0.0, 0.7071067811865476, 0.0, 0.7071067811865476])


def frame_of(parent: str, child: str, T: Matrix) -> dict[str, Any]:
    return {
        "parent": parent,
        "child": child,
        "translation": [*T[:3, 3]],
        "rotation": [float(one) for one in quaternion_of(T)],
    }


FIXED_FRAMES = [frame_of(BASE, SENSOR, T_BASE_SENSOR), frame_of(SENSOR, IMU, T_SENSOR_IMU)]


class Robot:
    """A robot that is steered and heard.

    Attributes:
        events: all that it said.
    """

    def __init__(self) -> None:
        self.events: list[dict[str, Any]] = []

    @property
    def is_running(self) -> bool:
        """False once its program has ended."""
        raise NotImplementedError

    def tell(self, **command: Any) -> None:
        """Gives it a command."""
        raise NotImplementedError

    def show(self, points: Path, T_map_sensor: Matrix) -> None:
        """Gives its sensors something to see: a file of ``write_points``, from a pose at rest."""
        up = T_map_sensor[2, :3] * GRAVITY_M_S2  # an accelerometer at rest feels the floor
        self.tell(show={"points": str(points), "acceleration": [*(T_SENSOR_IMU[:3, :3].T @ up)]})

    def call(self, number: int) -> None:
        """Calls the service, as soon as it is found."""
        self.tell(call=number)

    def of(self, event: str) -> list[dict[str, Any]]:
        """Returns what it said of a kind of event."""
        return [one for one in list(self.events) if one["event"] == event]

    def wait_for(self, event: str, count: int = 1) -> dict[str, Any]:
        """Waits until it said so much of a kind of event, and returns the last of these."""
        wait_until(lambda: len(self.of(event)) >= count or not self.is_running, what=event)
        assert self.is_running, "the robot's program ended"
        return self.of(event)[count - 1]

    def wait_until_known(self) -> None:
        """Waits until the gateway and the robot know each other's topics. The status is the last of them."""
        self.wait_for("service")
        self.wait_for("first_fix/status")

    def has_response(self, number: int) -> bool:
        """Returns whether the response to a call has come."""
        return any(one["call"] == number for one in self.of("response"))


class RobotProgram(Robot):
    """A program that is one robot.

    Args:
        command: takes commands as lines, and ends with its input.
    """

    def __init__(self, command: Sequence[Path | str], environment: Mapping[str, str] | None = None) -> None:
        super().__init__()
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment
        )
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    @property
    def is_running(self) -> bool:
        """False once it has ended."""
        return self._process.poll() is None

    def tell(self, **command: Any) -> None:
        """Gives it a command."""
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps(command) + "\n")
        self._process.stdin.flush()

    def end(self) -> None:
        """Ends it."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait(LIMIT_S)
        self._thread.join(LIMIT_S)

    def take(self, event: dict[str, Any]) -> None:
        """Takes what it said."""
        self.events.append(event)

    def _listen(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self.take(json.loads(line))


def write_points(scan: Scan, path: Path) -> Path:
    """Writes a scan's points as the robot reads them."""
    rows = np.zeros((len(scan.points), 4), "<f4")
    rows[:, :3] = scan.points
    path.write_bytes(rows.tobytes())
    return path


def stamp_ns(stamped: dict[str, int]) -> int:
    """Returns a time of an event in nanoseconds."""
    return stamped["sec"] * 10**9 + stamped["nanosec"]


def T_map_sensor_of(event: dict[str, Any]) -> Matrix:
    """Returns the sensor's pose (4, 4) by a heard pose of the base."""
    pose = event["message"]["pose"]["pose"]
    position, turn = pose["position"], pose["orientation"]
    T_map_base = from_quaternion([position[c] for c in "xyz"], [turn[c] for c in "xyzw"])
    return T_map_base @ T_BASE_SENSOR
