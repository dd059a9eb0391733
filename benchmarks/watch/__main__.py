"""False alarms of the watch, and the time until it notices a robot that was moved.

    python -m benchmarks.watch --store DIR --map ID --poses POSES.csv [--queries 500] [--moves 20]

The gateway's core runs with the engine in this process, on held-out scans of a real place: each is turned,
thinned and made noisy by the seed. Its clock counts what the queries take, and a tenth of a second for every
cloud. The robot's own localization is wrong by some centimetres, as one that works is. For a move it stays
where it was, while the robot is somewhere else.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from firstfix.catalog.catalog import Catalog
from firstfix.decode import read_scan_file
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer
from firstfix.store.store import Store
from firstfix.transform import Matrix
from firstfix_cli.poses_csv import read_poses_csv
from firstfix_ros.robot.watch import Health

from .robot import CLOUD_EVERY_S, Clock, Scene, WatchedRobot, move

MOVED_M = 2.0
LONGEST_S = 30.0


def scenes(poses: Path, chance: np.random.Generator, count: int) -> list[Scene]:
    """Makes scenes from the scans, in their order."""
    rows = [row for row in read_poses_csv(poses) if row.T_map_sensor is not None]
    points = [np.asarray(read_scan_file(row.path).points, np.float64) for row in rows]
    made = []
    for number in range(count):
        of = number % len(rows)
        T_map_sensor = rows[of].T_map_sensor
        assert T_map_sensor is not None
        made.append(Scene.of(points[of], T_map_sensor, chance))
    return made


def false_alarms(robot: WatchedRobot, seen: list[Scene]) -> dict[str, Any]:
    """Lets a robot that knows its pose be checked once at every scene."""
    found: Counter[str] = Counter()
    astray = 0
    for scene in seen:
        robot.error = scene.error
        health = robot.checked(scene)
        found[health.value] += 1
        if health is Health.ASTRAY:
            astray += 1
            robot.restart()
    return {"queries": len(seen), "health": dict(found), "false_alarms": astray}


def noticed_after_s(robot: WatchedRobot, scene: Scene, moved: Matrix) -> float:
    """Lets a robot be healthy, moves it, and returns the seconds until it is called astray; inf: never."""
    robot.restart()
    robot.error = scene.error
    for _ in range(3):
        if robot.checked(scene) is Health.HEALTHY:
            break
    else:
        return math.nan  # the scan is not localized there, so nothing can be told
    for _ in range(
        int(scene.phase * robot.watch_s / CLOUD_EVERY_S)
    ):  # it is moved at any time between two checks
        robot.cloud(scene)
    robot.error = moved @ scene.error
    begin_s = robot.clock()
    while robot.clock() - begin_s < LONGEST_S:
        robot.cloud(scene)
        if robot.health is Health.ASTRAY:
            return robot.clock() - begin_s
    return math.inf


def main(arguments: Sequence[str]) -> int:
    """Prints the figures; 1 if there was a false alarm, or a move was not noticed."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.watch", description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--store", required=True)
    parser.add_argument("--map", required=True)
    parser.add_argument("--poses", required=True, type=Path)
    parser.add_argument("--queries", type=int, default=500)
    parser.add_argument("--moves", type=int, default=20)
    parser.add_argument("--watch", type=float, default=1.0)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args(arguments)
    catalog, begin_s = Catalog(Store.open(given.store)), time.process_time()
    version = catalog.active_version(given.map)
    assert version is not None, f"no active version of {given.map}"
    chance = np.random.default_rng(given.seed)
    with tempfile.TemporaryDirectory() as folder:
        localizer = Localizer(MapIndex.load(catalog.fetch_version(given.map, version, Path(folder))))
    robot = WatchedRobot(localizer.localize, Clock(), given.watch)
    figures = false_alarms(robot, scenes(given.poses, chance, given.queries))
    after_s = [
        noticed_after_s(robot, scene, move(MOVED_M, chance))
        for scene in scenes(given.poses, chance, given.moves)
    ]
    known = sorted(one for one in after_s if not math.isnan(one))
    figures |= {
        "moves": len(known),
        "not_localized_before_the_move": len(after_s) - len(known),
        "noticed": sum(map(math.isfinite, known)),
        "within_3_s": sum(one <= 3.0 for one in known),
        "median_s": round(known[len(known) // 2], 2) if known else None,
        "slowest_s": round(known[-1], 2) if known else None,
        "cpu_s": round(time.process_time() - begin_s, 1),
    }
    print(json.dumps({"map": given.map, "seed": given.seed, **figures}))
    return int(figures["false_alarms"] > 0 or not all(map(math.isfinite, known)))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
