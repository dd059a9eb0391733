"""Search for the shortest move after which the hypotheses of an ambiguous answer should look different."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...answer.hint import Hint
from ...scan.levelling import levelling_rotation, turned
from ...scan.reduction import directions
from ...transform import Matrix, make_transform, rotation_z
from ..preprocess import PreparedQuery
from ..registered_candidate import RegisteredCandidate
from .outlook import FieldOfView, Outlook
from .ways import SHORT_WAY_M, WAYS_M, Floor, free_lengths, goals_at

MAX_COMPARED = 3
RIVAL_SHARE = 0.1  # of the first hypothesis's probability; a less probable one does not count
ENOUGH = 0.2  # separation at which the search ends
MIN_SEPARATION = 0.01  # separation of a hint
CLEARLY = 0.005  # by which a longer way must be better
TURNS_DEG = (60.0, -60.0, 120.0, -120.0, 180.0)
MAX_MOVES = 24
LIKELY = 1e-3  # is added to every probability: an improbable hypothesis may still be right


@dataclass(frozen=True)
class _Move:
    T_sensor_goal: Matrix
    distance_m: float
    turn_deg: float = 0.0


@dataclass(frozen=True)
class _Ground:
    """Floor under one hypothesis.

    Attributes:
        T_level_sensor: (4, 4) of the hypothesis.
        foot: (3,) from the sensor down to the floor, in the sensor frame.
        floor: None: a robot cannot stand at the hypothesis itself, so the floor says nothing.
    """

    T_level_sensor: Matrix
    foot: NDArray[np.float64]
    floor: Floor | None

    @classmethod
    def under(cls, one: RegisteredCandidate, height_m: float, up: NDArray[np.float64]) -> _Ground:
        index, T_level_sensor = one.index, one.registration.T_level_sensor
        foot = -height_m * up
        spot = T_level_sensor[:3, :3] @ foot + T_level_sensor[:3, 3]
        floor = Floor.around(index.cascade, index.config.spacing_m, spot)
        return cls(T_level_sensor, foot, floor if floor.carries(spot[None])[0] else None)

    def carries(self, goals: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Whether the whole way to each of (g, 3) goals in the sensor frame has a floor."""
        if self.floor is None or not len(goals):
            return np.ones(len(goals), np.bool_)
        shares = np.linspace(0, 1, math.ceil(float(np.linalg.norm(goals[0]))) + 1)[1:]
        way = self.foot + shares[:, None, None] * goals  # (steps, g, 3)
        R, origin = self.T_level_sensor[:3, :3], self.T_level_sensor[:3, 3]
        on_floor = self.floor.carries((way @ R.T + origin).reshape(-1, 3))
        return np.asarray(on_floor.reshape(len(shares), len(goals)).all(axis=0))


def find_hint(
    prepared: PreparedQuery, ranked: Sequence[RegisteredCandidate], probability: Sequence[float]
) -> Hint | None:
    """Hint of an ambiguous answer. None if no move within reach tells the hypotheses apart.

    Args:
        prepared: the query.
        ranked: its hypotheses, best first.
        probability: of each.
    """
    numbers = [
        number
        for number, share in enumerate(probability)
        if number < 2 or share >= RIVAL_SHARE * probability[0]
    ][:MAX_COMPARED]
    if len(numbers) < 2:
        return None
    compared = [ranked[number] for number in numbers]
    weights = np.array([probability[number] for number in numbers]) + LIKELY
    seen = FieldOfView.of(prepared.scans[-1].view)
    best: Hint | None = None
    for moves in _moves_by_length(prepared, compared, seen):
        if best is not None and (best.separation >= ENOUGH or moves[0].distance_m == SHORT_WAY_M):
            break
        for move in moves:
            misfits = _least_misfits(compared, move.T_sensor_goal, seen)
            separation = float(misfits @ weights / weights.sum())
            if separation >= MIN_SEPARATION and (best is None or separation >= best.separation + CLEARLY):
                apart = tuple(numbers[row] for row in np.flatnonzero(misfits >= MIN_SEPARATION).tolist())
                best = Hint(move.T_sensor_goal, move.distance_m, move.turn_deg, separation, apart)
    return best


def _moves_by_length(
    prepared: PreparedQuery, compared: Sequence[RegisteredCandidate], seen: FieldOfView
) -> Iterator[list[_Move]]:
    """Move that are free under every hypothesis: turns on the spot, ever longer ways, then the short one."""
    last = prepared.scans[-1]
    up = compared[0].registration.T_level_sensor[2, :3]
    R_level_sensor = levelling_rotation(up)
    if not seen.is_all_round(up):
        yield [_turn(R_level_sensor, turn_deg) for turn_deg in TURNS_DEG]
    here = [Outlook.at(one.index.view, one.registration.T_level_sensor) for one in compared]
    nearest = np.min([outlook.nearest for outlook in here], axis=0)
    mapped = directions() * nearest[:, None]
    scanned = turned(last.seen, last.T_last_scan[:3, :3]) + last.T_last_scan[:3, 3].astype(np.float32)
    lengths = free_lengths(turned(np.concatenate([mapped, scanned]), R_level_sensor), last.height_m)
    floors = [_Ground.under(one, last.height_m, up) for one in compared]
    left = MAX_MOVES
    for way_m in (*WAYS_M, SHORT_WAY_M):
        goals = goals_at(lengths, way_m) @ R_level_sensor[:2]  # (g, 3) in the sensor frame
        is_free = np.logical_and.reduce([ground.carries(goals) for ground in floors])
        chosen = goals[is_free][:left]
        left -= len(chosen)
        if len(chosen):
            yield [_Move(make_transform(np.eye(3), goal), way_m) for goal in chosen]


def _turn(R_level_sensor: NDArray[np.float64], turn_deg: float) -> _Move:
    turn = R_level_sensor.T @ rotation_z(np.radians(turn_deg)) @ R_level_sensor
    return _Move(make_transform(turn, np.zeros(3)), 0.0, turn_deg)


def _least_misfits(
    compared: Sequence[RegisteredCandidate], T_sensor_goal: Matrix, seen: FieldOfView
) -> NDArray[np.float64]:
    """For each place, how badly a scan taken at its goal fits the one of the others that it fits best."""
    outlooks = [
        Outlook.at(one.index.view, one.registration.T_level_sensor @ T_sensor_goal) for one in compared
    ]
    return np.array(
        [min(own.misfit(other, seen) for other in outlooks if other is not own) for own in outlooks]
    )
