"""What passes where: robots on each distribution and middleware that is here, and each edge of the gateway.

    firstfix-lab ros [--starts 5] [--also jazzy:rmw_cyclonedds_cpp=PREFIX]

It prints the rows of docs/how-to/ros.md. ``--also`` names a middleware that was built elsewhere.
"""

from __future__ import annotations

import argparse
import os
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from firstfix.answer.localization import Localization, Verdict
from firstfix.scan.scan import Scan
from tests.dds_loopback import LOOPBACK
from tests.fake_service import FakeService
from tests.robots.real_robots import Network, ros_robots
from tests.robots.real_ros import DISTRIBUTIONS, FAST_DDS, real_ros
from tests.robots.robot_program import write_points
from tests.waiting import wait_until

POINTS = 100
TOPICS_WITHIN_S, REPLY_WITHIN_S = 40.0, 10.0
OUT = ("initialpose", "first_fix/pose", "first_fix/status", "tf")
EDGES = ("rclpy", "--dds")


def _happens(condition: Callable[[], object], within_s: float) -> bool:
    try:
        wait_until(condition, within_s)
    except AssertionError:
        return False
    return True


def cell(network: Network, service: FakeService, edge: str, points: Path, starts: int) -> tuple[int, int]:
    """Returns how many robots heard all topics, and how many got a reply."""
    heard = answered = 0
    options = ["--imu", "imu", "--domain", str(network.domain)]
    if edge != "rclpy":
        options.append(edge)
    with (
        network.gateway(service.url, "hall", *options, with_ros=edge == "rclpy"),
        ros_robots(network.ros, network.environment) as robots,
    ):
        for number in range(starts):
            robot = robots.robot(f"/robot{number}")
            robot.show(points, np.eye(4))
            heard += _happens(lambda of=robot: all(map(of.of, OUT)), TOPICS_WITHIN_S)  # type: ignore[misc]
            robot.call(1)
            answered += _happens(lambda of=robot: of.of("response"), REPLY_WITHIN_S)  # type: ignore[misc]
            robot.go()
    return heard, answered


@contextmanager
def _service() -> Iterator[FakeService]:
    running = FakeService(
        {POINTS: Localization(Verdict.LOCALIZED, (), np.eye(4), np.eye(4), np.eye(6), 0.99, map_id="hall")}
    )
    try:
        yield running
    finally:
        running.stop()


def main(argv: Sequence[str]) -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--starts", type=int, default=5)
    parser.add_argument("--also", action="append", default=[])
    given = parser.parse_args(argv)
    os.environ["CYCLONEDDS_URI"] = LOOPBACK
    cases = [(distribution, FAST_DDS, "") for distribution in DISTRIBUTIONS]
    for one in given.also:
        distribution, _, rest = one.partition(":")
        middleware, _, prefix = rest.partition("=")
        cases.append((distribution, middleware, prefix))
    print("| distribution | middleware | edge | topics | replies of the service |\n|---|---|---|---|---|")
    with _service() as service, tempfile.TemporaryDirectory() as folder:
        spread = np.random.default_rng(1).uniform(-9, 9, (POINTS, 3))
        points = write_points(Scan(spread), Path(folder) / "points.bin")
        for distribution, middleware, prefix in cases:
            for edge in EDGES:
                network = Network(real_ros(distribution), Path(folder))
                network.environment["RMW_IMPLEMENTATION"] = middleware
                if prefix:
                    network.environment["CYCLONEDDS_URI"] = LOOPBACK
                    for name, added in (("LD_LIBRARY_PATH", f"{prefix}/lib"), ("AMENT_PREFIX_PATH", prefix)):
                        network.environment[name] = os.pathsep.join([added, network.environment[name]])
                    # ROS 2 from Python packages knows Fast DDS alone, and takes what is there first.
                    network.environment["LD_PRELOAD"] = f"{prefix}/lib/lib{middleware}.so"
                heard, answered = cell(network, service, edge, points, given.starts)
                scores = f"{heard} of {given.starts} | {answered} of {given.starts}"
                print(f"| {distribution} | {middleware} | `{edge}` | {scores} |", flush=True)
