"""A service, the gateway on DDS and scenes of a real place: what a robot of another DDS is tried in."""

from __future__ import annotations

import json
import os
import random
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from firstfix.scan.scan import Scan
from firstfix.scan_file import read_scan_file
from firstfix.transform import Matrix, make_transform, pose_error, rotation_z
from firstfix_cli.poses_csv import read_poses_csv
from firstfix_lab.common.programs import replica
from tests.dds_loopback import LOOPBACK
from tests.robots.robot_program import BASE, Robot, T_map_sensor_of, stamp_ns, write_points
from tests.waiting import wait_until


@dataclass(frozen=True)
class Scene:
    """View of a robot: a file of ``write_points``, and where its sensor is."""

    points: Path
    T_map_sensor: Matrix


def scenes(poses: Path, folder: Path, count: int, seed: int = 0, points: int | None = None) -> list[Scene]:
    """Makes scenes from held-out scans: each is turned about the sensor's axis by an angle of its own.

    Args:
        poses: ``poses.csv`` of the scans.
        folder: for the points.
        points: of a scene, at most, by chance; None: all.
    """
    chance = random.Random(seed)
    rows = read_poses_csv(poses)
    made = []
    for number in range(count):
        row = rows[number % len(rows)]
        assert row.T_map_sensor is not None, f"{row.path} was not taken in this place"
        turn = make_transform(rotation_z(chance.uniform(-3.14, 3.14)), [0.0, 0.0, 0.0])
        found = read_scan_file(row.path).points
        if points is not None:
            found = found[sorted(chance.sample(range(len(found)), min(points, len(found))))]
        scan = Scan(found @ turn[:3, :3].astype(found.dtype))
        made.append(Scene(write_points(scan, folder / f"scene-{number}.bin"), row.T_map_sensor @ turn))
    return made


def on_link(address: str) -> str:
    """Returns CYCLONEDDS_URI for the interface with an address. Others are found by multicast, as usual."""
    return (
        "<CycloneDDS><Domain><General>"
        f"<Interfaces><NetworkInterface address='{address}' multicast='true'/></Interfaces>"
        "<AllowMulticast>spdp</AllowMulticast></General></Domain></CycloneDDS>"
    )


@contextmanager
def gateway(
    folder: Path, store: Path, map_id: str, domain: int, network: str = LOOPBACK, options: Sequence[str] = ()
) -> Iterator[Path]:
    """Runs a service with the store, and ``firstfix ros-gateway --dds`` with it, as long as the block lasts.

    Args:
        folder: for logs and caches.
        network: CYCLONEDDS_URI.
        options: more of the gateway.

    Returns:
        the gateway's log.
    """
    log = folder / "gateway.log"
    command = [sys.executable, "-m", "firstfix_cli.main", "ros-gateway", "--dds", "--domain", str(domain)]
    command += ["--map", map_id, "--imu", "imu", "--base-frame", BASE, *options]
    with replica(folder / "service", store=str(store), run_builds=False) as service, log.open("wb") as out:
        process = subprocess.Popen(
            [*command, "--url", service.url],
            stdout=out,
            stderr=out,
            env={**os.environ, "CYCLONEDDS_URI": network, "PYTHONUNBUFFERED": "1"},
        )
        try:
            wait_until(lambda: b"looking for robots" in log.read_bytes() or process.poll() is not None)
            assert process.poll() is None, log.read_text()
            yield log
        finally:
            process.terminate()
            process.wait()


def pose_after(robot: Robot, begin_ns: int) -> dict[str, Any]:
    """Waits for the first pose to start from that belongs to a cloud after a time."""

    def found() -> list[dict[str, Any]]:
        stamps = [(stamp_ns(one["message"]["header"]["stamp"]), one) for one in robot.of("initialpose")]
        return [one for stamp, one in stamps if stamp >= begin_ns]

    wait_until(found, what=f"a pose; last said: {json.dumps(robot.events[-1:])[:400]}")
    return found()[0]


def check_pose(event: dict[str, Any], scene: Scene) -> float:
    """Checks the frame, and returns the distance to the true pose in metres."""
    assert event["message"]["header"]["frame_id"] == "map"
    return pose_error(scene.T_map_sensor, T_map_sensor_of(event))[0]
