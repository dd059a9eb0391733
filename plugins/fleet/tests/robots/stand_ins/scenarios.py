"""What must hold between the gateway and localizers, at real speed. Each scenario returns its figures."""

from __future__ import annotations

import random
import signal
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from plugins.fleet.tests.robots.stand_ins.autoware import InitialPoseAdaptor, PoseInitializer
from plugins.fleet.tests.robots.stand_ins.localizer import Localizer
from plugins.fleet.tests.robots.stand_ins.mola import MolaBridge
from plugins.fleet.tests.robots.stand_ins.nav2 import Amcl, reinitialize_global_localization
from plugins.fleet.tests.robots.stand_ins.robot import Robot
from plugins.fleet.tests.robots.stand_ins.robot_localization import EkfNode
from plugins.fleet.tests.robots.stand_ins.site import Site
from tests.waiting import let_pass, wait_until

NEAR_M = 0.3  # the error of a pose: messages of one moment are not taken at one moment


def late_starts(site: Site, count: int, within_s: float, seed: int) -> dict[str, Any]:
    """Localizers start at any time after the fix, while the robots drive on. Each must learn where it is.

    They start side by side, one for each robot.
    """
    chance = random.Random(seed)
    robots = [site.robot(f"/robot{number}") for number in range(count)]
    starts = sorted((chance.uniform(0, within_s), robot) for robot in robots)
    localizers: list[Localizer] = []
    with site.gateway("--repeat", "2"):
        for robot in robots:
            site.wait_for_fix(robot)
            robot.speed_m_s = 0.4
        before_s = 0.0
        for start_s, robot in starts:
            let_pass(start_s - before_s)
            before_s = start_s
            localizers.append(site.add(Amcl(robot)))
        for localizer in localizers:
            wait_until(lambda one=localizer: one.error_m < NEAR_M, what=f"the pose for {localizer.robot}")  # type: ignore[misc]
        for robot in robots:
            wait_until(lambda one=robot: site.state(one).get("localizer") == "followed")  # type: ignore[misc]
        let_pass(1.0)
    return {
        "starts": count,
        "got the pose": sum(localizer.error_m < NEAR_M for localizer in localizers),
        "largest error in m": round(max(localizer.error_m for localizer in localizers), 3),
        "poses to each": sorted(len(localizer.got) for localizer in localizers),
        "latest start in s": round(starts[-1][0], 1),
    }


def restarts(site: Site, count: int, seed: int) -> dict[str, Any]:
    """The gateway is ended and started again, in turn by SIGTERM and SIGKILL, while the robot drives."""
    chance = random.Random(seed)
    robot = site.robot("/robot")
    localizer = site.add(Amcl(robot))
    epochs: list[str] = []
    for number in range(count + 1):
        with site.gateway("--repeat", "2", end=(signal.SIGTERM, signal.SIGKILL)[number % 2]):
            site.wait_for_fix(robot, anew=True)
            epochs.append(site.state(robot)["epoch"])
            wait_until(lambda: localizer.error_m < NEAR_M)
            robot.speed_m_s = chance.choice([0.0, 0.3])
    return {"restarts": count, "epochs": len(set(epochs)), "poses to the localizer": len(localizer.got)}


def recipes(site: Site) -> dict[str, Any]:
    """All recipes side by side: each has a robot and a gateway of its own."""
    with ThreadPoolExecutor() as pool:
        running = {
            "nav2": pool.submit(recipe, site, Amcl),
            "mola": pool.submit(recipe, site, MolaBridge),
            "robot_localization": pool.submit(recipe, site, EkfNode, "--pose", "set_pose"),
            "autoware": pool.submit(autoware, site),
        }
        return {name: one.result() for name, one in running.items()}


def recipe(site: Site, make: Callable[[Robot], Localizer], *options: str) -> dict[str, Any]:
    """A localizer of a project starts late; then the node of a behaviour tree calls for a new search."""
    name = make.__name__.lower()
    robot = site.robot(f"/{name}", points=f"{name}_points")
    with site.gateway("--points", f"{name}_points", "--repeat", "2", *options):
        site.wait_for_fix(robot)
        first = site.state(robot)["epoch"]
        robot.speed_m_s = 0.4
        let_pass(1.0)
        localizer = site.add(make(robot))
        wait_until(lambda: localizer.error_m < NEAR_M)
        wait_until(lambda: site.state(robot).get("localizer") == "followed")
        assert site.state(robot)["epoch"] == first
        future = reinitialize_global_localization(robot, "first_fix/reinitialize_global_localization")
        wait_until(future.done)
        wait_until(lambda: site.state(robot).get("epoch", first) != first)
        wait_until(lambda: site.state(robot).get("localizer") == "followed")
        assert localizer.error_m < NEAR_M
    return {"error in m": round(localizer.error_m, 3), "poses": len(localizer.got)}


def autoware(site: Site) -> dict[str, Any]:
    """The alignment fails twice, then succeeds with a pose that it does not call reliable."""
    outcomes = iter([(False, False), (False, False)])
    robot = site.robot("", points="autoware_points", odometry=False)
    initializer = site.add(PoseInitializer(robot, lambda guess: next(outcomes, (True, False))))
    adaptor = site.add(InitialPoseAdaptor(robot))
    with site.gateway("--points", "autoware_points", "--repeat", "1", "--young", "200"):
        wait_until(lambda: initializer.is_initialized)
        wait_until(lambda: site.state(robot).get("localizer") == "followed")
    successes = [status.success for status in adaptor.answers]
    assert successes[:3] == [False, False, True], successes
    assert initializer.is_reliable is False
    error_m = max(float(abs(guess[:3, 3] - robot.T_map_base[:3, 3]).max()) for guess in initializer.guesses)
    assert error_m < NEAR_M
    return {"guesses": len(initializer.guesses), "error of the guess in m": round(error_m, 4)}
