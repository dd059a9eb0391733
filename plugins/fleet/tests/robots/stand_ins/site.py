"""A site: robots, localizers and a service in this process, and ``firstfix ros-gateway`` as another one."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from collections import ChainMap
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any, TypeVar

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from plugins.fleet.tests.robots.stand_ins.robot import FIRST_POINTS, Answers, Robot
from tests.fake_service import FakeService
from tests.waiting import LIMIT_S, wait_until

AnyNode = TypeVar("AnyNode", bound=Node)


class Site:
    """Robots, localizers and a service. Their nodes run in one thread.

    Args:
        folder: for the gateway's memory and log.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._context = rclpy.Context()
        self._context.init([])
        self._executor = SingleThreadedExecutor(context=self._context)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._spin, name="nodes")
        self._thread.start()
        self._lock = threading.Lock()
        self._robots = 0
        self._answers: list[Answers] = []
        self.service = FakeService({})
        self.states: dict[str, dict[str, str]] = {}  # the last diagnostics, by the robot's namespace

    def __enter__(self) -> Site:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stop.set()
        self._thread.join(LIMIT_S)
        self.service.stop()
        self._context.try_shutdown()

    def add(self, node: AnyNode) -> AnyNode:
        """Lets a node run."""
        self._executor.add_node(node)
        return node

    def remove(self, node: Node) -> None:
        """Ends a node."""
        self._executor.remove_node(node)
        node.destroy_node()

    def robot(self, namespace: str, *, points: str = "points", odometry: bool = True) -> Robot:
        """Adds a robot. The service tells robots apart by the numbers of points of their clouds."""
        with self._lock:
            self._robots += 1
            first_points = FIRST_POINTS * self._robots
        robot = Robot(namespace, self._context, odometry=odometry, points=points, first_points=first_points)
        robot.create_subscription(
            DiagnosticArray,
            "first_fix/status",
            lambda message: self._hear(robot.get_namespace(), message),
            10,
        )
        self._answers.append(Answers(robot))
        self.service.answers = ChainMap(*self._answers)  # type: ignore[arg-type]
        return self.add(robot)

    @contextmanager
    def gateway(self, *options: str, end: signal.Signals = signal.SIGTERM) -> Iterator[None]:
        """Runs a gateway of all robots.

        Args:
            end: signal by which it is ended.
        """
        command = [sys.executable, "-m", "firstfix_cli.main", "ros-gateway", "--map", "hall"]
        command += ["--url", self.service.url, "--base-frame", "base_link", "--memory", str(self._folder)]
        command += ["--no-publish-tf", "--domain", os.environ["ROS_DOMAIN_ID"], *options]
        with (self._folder / "gateway.log").open("ab") as log:
            process = subprocess.Popen(command, stdout=log, stderr=log)
        try:
            yield
        finally:
            process.send_signal(end)
            code = process.wait(LIMIT_S)
        assert code == (-end if end is signal.SIGKILL else 0), (self._folder / "gateway.log").read_text()

    def state(self, robot: Robot) -> dict[str, str]:
        """The last diagnostics of a robot."""
        return self.states.get(robot.get_namespace(), {})

    def wait_for_fix(self, robot: Robot, *, anew: bool = False) -> None:
        """Returns when a robot has its fix.

        Args:
            anew: what an earlier gateway said does not count.
        """
        if anew:
            self.states.pop(robot.get_namespace(), None)
        wait_until(
            lambda: self.state(robot).get("state") == "localized" and "epoch" in self.state(robot),
            what=f"a fix of {robot.get_namespace()}: {self.state(robot)}",
        )

    def _spin(self) -> None:
        while not self._stop.is_set():
            self._executor.spin_once(timeout_sec=0.05)

    def _hear(self, namespace: str, message: Any) -> None:
        self.states[namespace] = {value.key: value.value for value in message.status[0].values}
