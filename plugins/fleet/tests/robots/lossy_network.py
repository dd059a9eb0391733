"""The gateway at one end of a link that drops datagrams, a robot of another DDS at the other.

The link is that of the drill ``weak_link``: a relay between TUN devices drops packets by a seeded chance.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from firstfix_lab.drills.weak_link.link import Conditions, Link, weak_link
from plugins.fleet.tests.robots.dds_world import Scene, check_pose, gateway, on_link
from plugins.fleet.tests.robots.rust_robot import rust_robot
from tests.robots.robot_program import Robot, stamp_ns
from tests.waiting import wait_until

RATE_BIT_S, DELAY_S = 1e9, 0.001
POINTS = 20_000  # of a cloud: a robot with a bad link does not send all of them
_FIRST_CALLS, _FIRST_CALL_S = 30, 5.0
_TOLD_NS = 10**9
DOMAIN = 23  # nobody else is on this link


@dataclass
class Told:
    """Answers to the calls of a robot.

    Attributes:
        far_m: distances of the answers' poses from the truth.
        age_s: ages of their clouds when the robot heard the pose.
        datagrams: sent both ways.
        lost: share of them that was dropped.
        shown: what the robot saw, since when.
    """

    far_m: list[float] = field(default_factory=list)
    age_s: list[float] = field(default_factory=list)
    datagrams: int = 0
    lost: float = 0.0
    shown: list[tuple[int, Scene]] = field(default_factory=list)


@contextmanager
def robot_over(link: Link, program: Path, folder: Path, store: Path, map_id: str) -> Iterator[Robot]:
    """Runs the gateway here and a robot at the other end, as long as the block lasts. Both know each other.

    Its clouds are reliable. Others would hardly ever come through: no fragment of them may be lost.
    """
    robot_address = _other_end(link.address)
    around = ("ip", "netns", "exec", link.namespace)
    with (
        # First: Cyclone DDS repeats its first words to others every half minute only.
        rust_robot(
            program, "/robot", DOMAIN, network=robot_address, around=around, reliable_clouds=True
        ) as robot,
        gateway(folder, store, map_id, DOMAIN, on_link(link.address), ["--no-at-start"]),
    ):
        robot.wait_until_known()
        _get_an_answer(robot)
        yield robot


def _get_an_answer(robot: Robot) -> None:
    """Calls again and again until a call is answered.

    A client of ROS 2 sees a service before the service sees the client. What it calls in between is lost,
    whatever the quality of service. Where datagrams are lost, this takes seconds.
    """
    for number in range(_FIRST_CALLS):
        robot.call(-1 - number)
        with suppress(AssertionError):
            wait_until(lambda: robot.of("response"), _FIRST_CALL_S)
            return
    raise AssertionError("the service never answered")


def ask(robot: Robot, seen: list[Scene], told: Told) -> None:
    """Lets the robot ask at every scene, and waits for the response and the pose.

    A pose belongs to the cloud of its stamp. On a bad link this may be one from before the call, sent again.
    """
    for number, scene in enumerate(seen, start=len(told.far_m)):
        robot.show(scene.points, scene.T_map_sensor)
        told.shown.append((time.time_ns(), scene))
        poses = len(robot.of("initialpose"))
        robot.call(number)
        event = robot.wait_for("initialpose", poses + 1)
        wait_until(lambda call=number: robot.has_response(call), what="a response")
        told.age_s.append((stamp_ns(event["time"]) - stamp_ns(event["message"]["header"]["stamp"])) / 1e9)
        told.far_m.append(min(check_pose(event, one) for one in _seen_at(event, told.shown)))


def _seen_at(event: dict[str, Any], shown: list[tuple[int, Scene]]) -> list[Scene]:
    """Returns what the robot saw at a pose's stamp; while it is told what to see, the scene before, too."""
    at_ns = stamp_ns(event["message"]["header"]["stamp"])
    since = [(begin_ns, scene) for begin_ns, scene in shown if begin_ns <= at_ns]
    begin_ns = since[-1][0]
    return [scene for _, scene in since[-2:]] if at_ns - begin_ns < _TOLD_NS else [since[-1][1]]


@contextmanager
def lossy_link(loss: float, seed: int, told: Told) -> Iterator[Link]:
    """Gives the link, and afterwards the share that was lost."""
    with weak_link(Conditions(RATE_BIT_S, DELAY_S, loss), seed) as link:
        yield link
        told.datagrams = link.up.packets + link.down.packets
        told.lost = (link.up.lost + link.down.lost) / max(1, told.datagrams)


def _other_end(address: str) -> str:
    """The robot's address: the next one after this side's."""
    start, _, last = address.rpartition(".")
    return f"{start}.{int(last) + 1}"
