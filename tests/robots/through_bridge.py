"""Cold starts through two zenoh-DDS bridges: ``python -m tests.robots.through_bridge --bridge PROGRAM ...``.

Robots are in one DDS domain with a bridge, the gateway is in another with a bridge, and the bridges speak
zenoh over TCP. No test runs this: to build the bridge takes about six minutes of a processor, and clang,
cmake and git. See ``bridge/README.md``.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from benchmarks.common.programs import free_port
from tests.dds_loopback import LOOPBACK
from tests.robots import rust_robot
from tests.robots.dds_world import check_pose, gateway, scenes
from tests.waiting import wait_until

ROBOTS_DOMAIN, GATEWAY_DOMAIN = 61, 62
WITHIN_M = 0.2


@contextmanager
def bridge(program: Path, folder: Path, domain: int, zenoh: dict[str, object]) -> Iterator[None]:
    """Runs a bridge between a DDS domain and zenoh as long as the block lasts."""
    options = {"domain": domain, "ros_localhost_only": False}
    config = {
        **zenoh,
        "mode": "router",
        "scouting": {"multicast": {"enabled": False}},
        "timestamping": {"enabled": True},
        "adminspace": {"enabled": True},
        "plugins_loading": {"enabled": True},
        "plugins": {"ros2dds": options},
    }
    path, log = folder / f"bridge-{domain}.json5", folder / f"bridge-{domain}.log"
    path.write_text(json.dumps(config))
    with log.open("wb") as out:
        process = subprocess.Popen(
            [program, path], stdout=out, stderr=out, env={**os.environ, "CYCLONEDDS_URI": LOOPBACK}
        )
    try:
        yield
    finally:
        process.terminate()
        process.wait()


def main(arguments: Sequence[str]) -> int:
    """Runs the cold starts and prints the distance to each true pose."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--bridge", required=True, type=Path)
    parser.add_argument("--store", required=True, type=Path)
    parser.add_argument("--map", required=True)
    parser.add_argument("--poses", required=True, type=Path, help="poses.csv of held-out scans")
    parser.add_argument("--robot", type=Path, help="its program, if it is built elsewhere")
    parser.add_argument("--starts", type=int, default=20)
    given = parser.parse_args(arguments)
    address = f"tcp/127.0.0.1:{free_port()}"
    program, far_m = given.robot or rust_robot.build(), []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        seen = scenes(given.poses, folder, given.starts)
        with (
            bridge(
                given.bridge, folder, ROBOTS_DOMAIN, {"mode": "router", "listen": {"endpoints": [address]}}
            ),
            bridge(
                given.bridge, folder, GATEWAY_DOMAIN, {"mode": "router", "connect": {"endpoints": [address]}}
            ),
            gateway(folder, given.store, given.map, GATEWAY_DOMAIN, options=["--no-at-start"]),
        ):
            for number, scene in enumerate(seen):
                with rust_robot.rust_robot(program, f"/robot{number}", ROBOTS_DOMAIN) as robot:
                    robot.wait_until_known()
                    robot.show(scene.points, scene.T_map_sensor)
                    robot.call(number)
                    robot.wait_for("response")
                    wait_until(lambda of=robot.of: of("initialpose"))
                    far_m.append(check_pose(robot.wait_for("initialpose"), scene))
                    print(f"start {number}: {far_m[-1]:.3f} m", flush=True)
    print(json.dumps({"starts": len(far_m), "largest_m": round(max(far_m), 3)}))
    return int(max(far_m) >= WITHIN_M)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
