"""Robots and gateways on a real ROS 2."""

from __future__ import annotations

import itertools
import os
import signal
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from firstfix.transform import Matrix, make_transform, quaternion_of, rotation_z
from tests.claimed import any_domain
from tests.robots.real_ros import RealRos
from tests.robots.robot_program import BASE, FIXED_FRAMES, Robot, RobotProgram
from tests.waiting import LIMIT_S, wait_until

PROGRAM = Path(__file__).resolve().parent / "ros_robots.py"
T_ODOM_BASE = make_transform(rotation_z(0.7), [2.0, -1.0, 0.0])


def numbers_of(T: Matrix) -> list[float]:
    """Returns x, y, z, qx, qy, qz, qw of a pose (4, 4)."""
    return [float(one) for one in (*T[:3, 3], *quaternion_of(T))]


class RosRobot(Robot):
    """One of the robots of ``RosRobots``."""

    def __init__(self, program: RosRobots, namespace: str) -> None:
        super().__init__()
        self.namespace = namespace
        self._program = program

    @property
    def is_running(self) -> bool:
        """False once the program has ended."""
        return self._program.is_running

    def tell(self, **command: Any) -> None:
        """Gives it a command."""
        self._program.tell(robot=self.namespace, **command)

    @property
    def status(self) -> dict[str, Any]:
        """The last diagnosis that it heard, with ``values`` as a mapping; empty before the first."""
        heard = self.of("first_fix/status")
        if not heard:
            return {}
        (status,) = heard[-1]["message"]["status"]
        return status | {"values": {one["key"]: one["value"] for one in status["values"]}}

    def says(self, **wanted: Any) -> bool:
        """Returns whether its last diagnosis has these fields, or these values."""
        status = self.status
        values = status.get("values", {})
        return all(status.get(name, values.get(name)) == value for name, value in wanted.items())

    def fix(self) -> None:
        """Lets it publish its fixed frames."""
        self.tell(fix={"frames": FIXED_FRAMES})

    def go(self) -> None:
        """Destroys its node."""
        self.tell(go={})


class RosRobots(RobotProgram):
    """The program ``ros_robots.py``, whose robots come and go."""

    def __init__(self, ros: RealRos, environment: Mapping[str, str]) -> None:
        self.robots: dict[str, RosRobot] = {}
        super().__init__([ros.python, PROGRAM], environment)

    def robot(self, namespace: str, *, fixed: bool = True, odometry: bool = True, **options: Any) -> RosRobot:
        """Lets a robot come.

        Args:
            fixed: it publishes its fixed frames at once.
            options: see the program.
        """
        made = self.robots[namespace] = RosRobot(self, namespace)
        options["fixed"] = FIXED_FRAMES if fixed else []
        options["odometry"] = numbers_of(T_ODOM_BASE) if odometry else None
        made.tell(come=options)
        return made

    def take(self, event: dict[str, Any]) -> None:
        """Hands an event to its robot."""
        self.robots[event["robot"]].events.append(event)


class Network:
    """A ROS domain with robots, and gateways that serve them.

    Args:
        folder: for logs.
    """

    def __init__(self, ros: RealRos, folder: Path) -> None:
        self.ros, self._folder = ros, folder
        self.domain = any_domain()
        self.environment = ros.environment(self.domain, {"ROS_LOG_DIR": str(folder)})

    @contextmanager
    def gateway(self, url: str, map_id: str, *options: str, with_ros: bool = True) -> Iterator[Gateway]:
        """Runs ``firstfix ros-gateway`` as long as the block lasts.

        Args:
            with_ros: a ROS is sourced.
        """
        log = self._folder / f"gateway-{next(_numbers)}.log"
        command = [sys.executable, "-m", "firstfix_cli.main", "ros-gateway", "--url", url, "--map", map_id]
        environment = self.environment if with_ros else {**os.environ, "PYTHONUNBUFFERED": "1"}
        gateway = Gateway([*command, "--base-frame", BASE, *options], environment, log)
        try:
            yield gateway
        finally:
            gateway.end()


_numbers = itertools.count()


class Gateway:
    """A running ``firstfix ros-gateway``."""

    def __init__(self, command: list[str], environment: Mapping[str, str], log: Path) -> None:
        self.log = log
        with log.open("wb") as out:
            self._process = subprocess.Popen(command, env=environment, stdout=out, stderr=out)
        wait_until(lambda: "looking for robots" in self.text or self._process.poll() is not None)
        assert self._process.poll() is None, self.text

    @property
    def text(self) -> str:
        """All that it said."""
        return self.log.read_text()

    def end(self, number: signal.Signals = signal.SIGINT) -> int:
        """Ends it by a signal, if it runs, and returns its exit code."""
        if self._process.poll() is None:
            self._process.send_signal(number)
        return self._process.wait(LIMIT_S)


@contextmanager
def ros_robots(ros: RealRos, environment: Mapping[str, str]) -> Iterator[RosRobots]:
    """Runs a program of robots as long as the block lasts."""
    program = RosRobots(ros, environment)
    try:
        yield program
    finally:
        program.end()
