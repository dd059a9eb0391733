"""One ambiguous scan: the robot moves, takes another scan, and asks with all scans so far."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from firstfix.answer.localization import Localization, Verdict
from firstfix.engine.localizer import Localizer
from firstfix.scan.levelling import levelling_rotation
from firstfix.scan.scan import Scan
from firstfix.scan.sequence import ScanSequence
from firstfix.transform import Matrix, make_transform, pose_error
from firstfix_builder.simulation.perturb import ScanCase, ScanSimulation

MOVES = 2
RIGHT_M, RIGHT_DEG = 1.0, 10.0
_CLEARANCE_M = 0.2  # along a way, at the height of the sensor
_STEPS = 16
_TRIES = 200
Choose = Callable[[Matrix, Localization], "Matrix | None"]  # true pose and answer to T_sensor_goal, or None


@dataclass(frozen=True)
class Followed:
    """End of one attempt.

    Attributes:
        moves: made.
        blocked: moves whose way is not free in the true world.
        is_resolved: the last answer is ``localized``, and right.
        is_wrong: the last answer is ``localized``, and wrong.
        ways_m: length of every move.
    """

    moves: int
    blocked: int
    is_resolved: bool
    is_wrong: bool
    ways_m: tuple[float, ...]


def follow(
    localizer: Localizer,
    simulation: ScanSimulation,
    scan: Scan,
    T_map_sensor: Matrix,
    answer: Localization,
    choose: Choose,
    seed: int,
) -> Followed:
    """Moves up to MOVES times, as long as the answer is ambiguous and there is a move."""
    scans, poses = [scan], [T_map_sensor]
    ways_m: list[float] = []
    blocked = 0
    for number in range(MOVES):
        if answer.verdict is not Verdict.AMBIGUOUS:
            break
        T_sensor_goal = choose(poses[-1], answer)
        if T_sensor_goal is None:
            break
        blocked += not is_free(simulation, poses[-1], T_sensor_goal)
        ways_m.append(float(np.linalg.norm(T_sensor_goal[:3, 3])))
        poses.append(poses[-1] @ T_sensor_goal)
        scans.append(simulation.scan(ScanCase(poses[-1], seed + number)))
        answer = localizer.localize(ScanSequence.along(scans, poses))
    is_right = False
    if answer.T_map_sensor is not None:
        off_m, off_deg = pose_error(poses[-1], answer.T_map_sensor)
        is_right = off_m <= RIGHT_M and off_deg <= RIGHT_DEG
    is_localized = answer.verdict is Verdict.LOCALIZED
    return Followed(len(ways_m), blocked, is_right, is_localized and not is_right, tuple(ways_m))


def by_hint(T_map_sensor: Matrix, answer: Localization) -> Matrix | None:
    """The answer's own hint."""
    return None if answer.hint is None else answer.hint.T_sensor_goal


def at_random(simulation: ScanSimulation, ways_m: tuple[float, ...], rng: np.random.Generator) -> Choose:
    """Moves in random directions that are free in the true world, each as long as that of the hint."""
    left = list(ways_m)

    def choose(T_map_sensor: Matrix, answer: Localization) -> Matrix | None:
        if not left:
            return None
        way_m, R_level_sensor = left.pop(0), levelling_rotation(T_map_sensor[2, :3])
        for _ in range(_TRIES):
            heading = rng.uniform(-np.pi, np.pi)
            way = way_m * np.array([np.cos(heading), np.sin(heading), 0]) @ R_level_sensor
            T_sensor_goal = make_transform(np.eye(3), way)
            if is_free(simulation, T_map_sensor, T_sensor_goal):
                return T_sensor_goal
        return None

    return choose


def is_free(simulation: ScanSimulation, T_map_sensor: Matrix, T_sensor_goal: Matrix) -> bool:
    """Returns whether the sensor can go straight to its goal in the true world."""
    shares = np.linspace(0, 1, _STEPS + 1)[1:, None]
    way = shares * (T_map_sensor[:3, :3] @ T_sensor_goal[:3, 3]) + T_map_sensor[:3, 3]
    return bool(simulation.simulator.is_free(way, _CLEARANCE_M).all())
