"""A robot on DDS and a gateway on a network that drops datagrams: everything that is asked must be answered.

    firstfix-lab lossy_dds --store DIR --map ID --poses POSES.csv [--minutes 10] [--loss 0.3]

The robot is of another DDS (``tests/robots``). It publishes reliable clouds at 10 Hz and asks again
as soon as it has its pose. It never repeats a call. docs/how-to/ros.md says what was seen.
It needs root (network namespaces), cargo, and the package cyclonedds.
"""

from __future__ import annotations

import argparse
import json
import math
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from plugins.fleet.tests.robots import rust_robot
from plugins.fleet.tests.robots.dds_world import scenes
from plugins.fleet.tests.robots.lossy_network import POINTS, Told, ask, lossy_link, robot_over

from .weak_link.link import missing

WITHIN_M = 0.2


def main(arguments: Sequence[str]) -> int:
    """Run the drill."""
    parser = argparse.ArgumentParser(
        prog="firstfix-lab lossy_dds",
        description=__doc__,
        formatter_class=argparse.RawTextHelpFormatter,
    )
    parser.add_argument("--store", required=True, type=Path)
    parser.add_argument("--map", required=True)
    parser.add_argument("--poses", required=True, type=Path, help="poses.csv of held-out scans")
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--loss", type=float, default=0.3, help="share of the datagrams")
    parser.add_argument("--points", type=int, default=POINTS, help="of a cloud")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--robot", type=Path, help="its program, if it is built elsewhere")
    given = parser.parse_args(arguments)
    reason = missing() or (None if given.robot else rust_robot.missing())
    if reason is not None:
        print(reason)
        return 2
    told, took_s = Told(), []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        seen = scenes(given.poses, folder, 50, given.seed, given.points)
        program = given.robot or rust_robot.build()
        with (
            lossy_link(given.loss, given.seed, told) as link,
            robot_over(link, program, folder, given.store.resolve(), given.map) as robot,
        ):
            end = time.monotonic() + 60 * given.minutes
            while time.monotonic() < end:
                begin_s = time.monotonic()
                ask(robot, [seen[len(took_s) % len(seen)]], told)
                took_s.append(time.monotonic() - begin_s)
    figures = {
        "answered": len(took_s),  # each of them: one without an answer ends the drill
        "largest_m": round(max(told.far_m), 3),
        "seconds": _spread(took_s),  # from the call to the pose
        "age_s": _spread(told.age_s),  # from the cloud's stamp to the pose
        "datagrams": told.datagrams,
        "lost": round(told.lost, 3),
    }
    print(json.dumps(figures))
    return int(max(told.far_m) >= WITHIN_M)


def _spread(values: list[float]) -> dict[str, float]:
    ordered = sorted(values)
    shares = {"median": 0.5, "p95": 0.95, "most": 1.0}
    return {name: round(ordered[math.ceil(share * len(ordered)) - 1], 2) for name, share in shares.items()}
