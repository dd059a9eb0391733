"""Time that the gateway on DDS adds to a query over HTTP, and its memory.

A service on loopback answers at once, so the figures are those of the ways to it. Each round sends one
cloud over DDS to a running ``firstfix ros-gateway --dds``, until its pose is heard, and the same scan with
the Python client. Run it with ``python -m benchmarks.ros.gateway_overhead``.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import subprocess
import sys
import threading
import time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import numpy as np
from cyclonedds.core import InstanceState, Policy, Qos, ReadCondition, SampleState, ViewState, WaitSet
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration
from rosbags.typesys import Stores, get_typestore

from firstfix.answer.localization import Localization, Verdict
from firstfix.formats.point_cloud import SCAN_LIMITS
from firstfix.ros.point_cloud2 import decode_point_cloud2
from firstfix_cli.ros_gateway.dds.messages import TYPES, sample_of
from firstfix_client import Client

LOOPBACK = (
    "<CycloneDDS><Domain><General>"
    '<Interfaces><NetworkInterface name="lo" multicast="false"/></Interfaces>'
    "<AllowMulticast>false</AllowMulticast></General><Discovery>"
    "<ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>30</MaxAutoParticipantIndex>"
    '<Peers><Peer address="127.0.0.1"/></Peers></Discovery></Domain></CycloneDDS>'
)
ANSWER = Localization(Verdict.LOCALIZED, (), np.eye(4), None, np.eye(6), 0.99, map_id="hall")
RELIABLE = Policy.Reliability.Reliable(duration(seconds=1))


class Answers(BaseHTTPRequestHandler):
    """A service that answers every query at once."""

    protocol_version = "HTTP/1.1"
    body = json.dumps(ANSWER.to_mapping()).encode()

    def do_POST(self) -> None:
        self.rfile.read(int(self.headers["Content-Length"]))
        self.send_response(200)
        self.send_header("Content-Type", "application/json")
        self.send_header("Content-Length", str(len(self.body)))
        self.end_headers()
        self.wfile.write(self.body)

    def log_message(self, *_: Any) -> None:
        pass


def cloud_message(points: int) -> bytes:
    """A PointCloud2 of a room's walls as rosbags writes it."""
    ros = get_typestore(Stores.ROS2_HUMBLE)
    rng = np.random.default_rng(1)
    directions = rng.normal(size=(points, 3))
    directions /= np.abs(directions).max(axis=1, keepdims=True)
    xyz = np.ascontiguousarray(directions * [15, 10, 3], "<f4")
    kinds = ros.types
    fields = [kinds["sensor_msgs/msg/PointField"](axis, 4 * i, 7, 1) for i, axis in enumerate("xyz")]
    stamp = kinds["builtin_interfaces/msg/Time"](7, 0)
    message = kinds["sensor_msgs/msg/PointCloud2"](
        header=kinds["std_msgs/msg/Header"](stamp=stamp, frame_id="lidar"),
        height=1,
        width=points,
        fields=fields,
        is_bigendian=False,
        point_step=12,
        row_step=12 * points,
        data=xyz.view(np.uint8).ravel(),
        is_dense=True,
    )
    return bytes(ros.serialize_cdr(message, "sensor_msgs/msg/PointCloud2"))


class Robot:
    """Publishes clouds, calls the service, and waits for poses."""

    def __init__(self, domain: int) -> None:
        self._domain = Domain(domain, LOOPBACK)
        self.participant = DomainParticipant(domain)
        self.clouds = self._writer("rt/points", "sensor_msgs/msg/PointCloud2")
        self.requests = self._writer("rq/first_fix/relocalizeRequest", "std_srvs/srv/Trigger_Request")
        self.replies, self._replied = self._reader(
            "rr/first_fix/relocalizeReply", "std_srvs/srv/Trigger_Response"
        )
        self.poses, self._posed = self._reader(
            "rt/initialpose", "geometry_msgs/msg/PoseWithCovarianceStamped"
        )

    def _topic(self, name: str, ros_type: str) -> Any:
        return Topic(self.participant, name, TYPES[ros_type])

    def _writer(self, name: str, ros_type: str) -> Any:
        return DataWriter(self.participant, self._topic(name, ros_type), Qos(RELIABLE))

    def _reader(self, name: str, ros_type: str) -> tuple[Any, WaitSet]:
        reader = DataReader(self.participant, self._topic(name, ros_type), Qos(RELIABLE))
        waitset = WaitSet(self.participant)
        waitset.attach(ReadCondition(reader, SampleState.Any | ViewState.Any | InstanceState.Any))
        return reader, waitset

    def relocalize(self) -> None:
        self.requests.write(sample_of(self.requests.data_type, b"\0\1\0\0" + bytes(17)))
        assert self._replied.wait(duration(seconds=10))
        self.replies.take(10)

    def fix(self, cloud: bytes) -> float:
        """Returns the seconds from a cloud to its pose."""
        begin_s = time.perf_counter()
        self.clouds.write(sample_of(self.clouds.data_type, cloud))
        assert self._posed.wait(duration(seconds=10))
        took_s = time.perf_counter() - begin_s
        self.poses.take(10)
        return took_s


def resident_mb(pid: int) -> float:
    """Resident memory of a process."""
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def main() -> None:
    """Prints the medians and the memory."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=100)
    parser.add_argument("--points", type=int, default=30_000)
    options = parser.parse_args()
    service = ThreadingHTTPServer(("127.0.0.1", 0), Answers)
    threading.Thread(target=service.serve_forever, daemon=True).start()
    url = f"http://127.0.0.1:{service.server_port}"
    domain = random.SystemRandom().randrange(1, 100)
    arguments = ["ros-gateway", "--dds", "--map", "hall", "--url", url, "--domain", str(domain)]
    gateway = subprocess.Popen(
        [sys.executable, "-m", "firstfix_cli.main", *arguments, "--no-at-start"],
        stdout=subprocess.DEVNULL,
        env={**os.environ, "CYCLONEDDS_URI": LOOPBACK},
    )
    cloud = cloud_message(options.points)
    scan = decode_point_cloud2(cloud, SCAN_LIMITS).scan()
    robot = Robot(domain)
    through, direct = [], []
    try:
        while not (robot.requests.matched_sub and robot.clouds.matched_sub):
            time.sleep(0.1)
            robot.requests.write(sample_of(robot.requests.data_type, b"\0\1\0\0" + bytes(17)))
        time.sleep(2)
        robot.fix(cloud)
        with Client(url) as client:
            for _ in range(options.rounds):
                robot.relocalize()
                time.sleep(0.3)  # the gateway subscribes to clouds again
                through.append(robot.fix(cloud))
                begin_s = time.perf_counter()
                client.localize(scan, map_id="hall")
                direct.append(time.perf_counter() - begin_s)
        memory = resident_mb(gateway.pid)
    finally:
        gateway.terminate()
        gateway.wait()
    a, b = 1e3 * np.array(through), 1e3 * np.array(direct)
    print(f"through the gateway {np.median(a):.2f} ms, over HTTP alone {np.median(b):.2f} ms (medians)")
    print(
        f"added by the gateway {np.median(a - b):.2f} ms at the median, {np.percentile(a - b, 95):.2f} at p95"
    )
    print(f"resident memory of the gateway {memory:.0f} MB after {options.rounds} fixes")


if __name__ == "__main__":
    main()
