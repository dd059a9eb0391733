"""Metrics of an evaluation: pure functions of answers and true poses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firstfix.answer.localization import Localization, Verdict
from firstfix.scan.scan import Scan
from firstfix.transform import (
    Matrix,
    inverse,
    make_transform,
    pose_error,
    quaternion_of,
    rotation_z,
)

SUCCESS_M = (0.05, 0.2, 0.5, 1.0)
SUCCESS_YAW_DEG = 5.0
RANKED_M = 0.2  # a hypothesis this close counts as the true place
ANGLES_DEG = (1.0, 2.0, 5.0)
FALSE_M, FALSE_DEG = 1.0, 10.0  # an accepted pose further off than this is a false accept
WRONG_M = 0.2  # a robot that is further off misses doors and docks


@dataclass(frozen=True)
class Outcome:
    """One query of an evaluation.

    Attributes:
        name: name of the scan.
        T_map_sensor: (4, 4) true pose, or None: the scan was not taken in this map.
        answer: the answer.
        ms: time from the query to the answer, measured by the caller.
        error_m: distance of the answered pose from the true one; inf if there is none.
        error_deg: angle of the rotation between them; inf if there is none.
        yaw_error_deg: its part about the map's vertical axis.
        first_error_m: distance of the first hypothesis from the true pose, whatever the verdict; inf if
            there is none, or its yaw is off by more than SUCCESS_YAW_DEG.
        among_error_m: the same for the nearest of all hypotheses.
    """

    name: str
    T_map_sensor: Matrix | None
    answer: Localization
    ms: float
    error_m: float
    error_deg: float
    yaw_error_deg: float
    first_error_m: float = np.inf
    among_error_m: float = np.inf

    @property
    def is_accepted(self) -> bool:
        """True if the verdict is ``localized``."""
        return self.answer.verdict is Verdict.LOCALIZED

    @property
    def is_false_accept(self) -> bool:
        """True if the scan was localized at a wrong pose."""
        return self.is_accepted and not (self.error_m <= FALSE_M and self.error_deg <= FALSE_DEG)

    @property
    def is_wrong(self) -> bool:
        """True if the scan was localized over 0.2 m off, or is a false accept."""
        return self.is_accepted and not (self.error_m <= WRONG_M and self.error_deg <= FALSE_DEG)

    def is_within(self, limit_m: float, yaw_deg: float = SUCCESS_YAW_DEG) -> bool:
        """True if the answered pose is this close to the true one."""
        return self.error_m <= limit_m and self.yaw_error_deg <= yaw_deg


def outcome_of(name: str, T_map_sensor: Matrix | None, answer: Localization, ms: float) -> Outcome:
    """Compare an answer with the true pose."""
    if T_map_sensor is None:
        return Outcome(name, None, answer, ms, np.inf, np.inf, np.inf)
    errors_m = [_error_m(T_map_sensor, hypothesis.T_map_sensor) for hypothesis in answer.hypotheses]
    ranked = (next(iter(errors_m), np.inf), min(errors_m, default=np.inf))
    if answer.T_map_sensor is None:
        return Outcome(name, T_map_sensor, answer, ms, np.inf, np.inf, np.inf, *ranked)
    error_m, error_deg = pose_error(T_map_sensor, answer.T_map_sensor)
    yaw_error_deg = _yaw_error_deg(T_map_sensor, answer.T_map_sensor)
    return Outcome(name, T_map_sensor, answer, ms, error_m, error_deg, yaw_error_deg, *ranked)


def report_of(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """The metrics that ``--json`` writes.

    ``success_*``: share of the scans with a true pose that were localized within this distance, and within
    5 degrees of yaw. ``first_0.2m`` and ``among_0.2m``: share of them whose first hypothesis, or any, is this
    close, whatever the verdict. If another than the first is close, the place was found but ranked wrongly.
    ``median_*``: over the localized scans with a true pose, None if there are none. ``false_accept_rate``:
    share of the localized scans that are off by more than 1 m or 10 degrees, or were not taken in this map.
    ``wrong_0.2m_rate``: the same with 0.2 m in place of 1 m.
    """
    posed = [o for o in outcomes if o.T_map_sensor is not None]
    accepted = [o for o in outcomes if o.is_accepted]
    measured = [o for o in accepted if o.T_map_sensor is not None]
    ms = [o.ms for o in outcomes]
    return {
        "n": len(outcomes),
        **{f"success_{limit:g}m": _share([o.is_within(limit) for o in posed]) for limit in SUCCESS_M},
        f"first_{RANKED_M:g}m": _share([o.first_error_m <= RANKED_M for o in posed]),
        f"among_{RANKED_M:g}m": _share([o.among_error_m <= RANKED_M for o in posed]),
        "median_error_m": float(np.median([o.error_m for o in measured])) if measured else None,
        "median_error_deg": float(np.median([o.error_deg for o in measured])) if measured else None,
        "false_accept_rate": _share([o.is_false_accept for o in accepted]),
        f"wrong_{WRONG_M:g}m_rate": _share([o.is_wrong for o in accepted]),
        "verdicts": {v.value: sum(o.answer.verdict is v for o in outcomes) for v in Verdict},
        "ms": {f"p{q}": float(np.percentile(ms, q)) if ms else None for q in (50, 95, 99)},
    }


def angle_shares(outcomes: Sequence[Outcome]) -> dict[str, float]:
    """The share of scans with a true pose within 1 m and 1, 2 and 5 degrees of yaw."""
    posed = [o for o in outcomes if o.T_map_sensor is not None]
    return {f"{limit:g}deg": _share([o.is_within(1.0, limit) for o in posed]) for limit in ANGLES_DEG}


def turned(scan: Scan, T_map_sensor: Matrix | None, yaw_rad: float) -> tuple[Scan, Matrix | None]:
    """Scan and pose of the same sensor mounted at another heading."""
    T_turned_sensor = make_transform(rotation_z(yaw_rad), np.zeros(3))
    points = (scan.points @ T_turned_sensor[:3, :3].T).astype(np.float32)
    pose = None if T_map_sensor is None else T_map_sensor @ inverse(T_turned_sensor)
    return Scan(points, scan.intensity, scan.stamp_s, scan.time_s), pose


def random_yaws(count: int, seed: int | None) -> NDArray[np.float64]:
    """(count,) radians that depend only on the seed; zeros without a seed."""
    if seed is None:
        return np.zeros(count)
    return np.random.default_rng(seed).uniform(-np.pi, np.pi, count)


def _error_m(T_map_sensor: Matrix, T_map_found: Matrix) -> float:
    """The distance of a hypothesis from the true pose; infinite if its yaw is wrong."""
    if _yaw_error_deg(T_map_sensor, T_map_found) > SUCCESS_YAW_DEG:
        return float(np.inf)
    return pose_error(T_map_sensor, T_map_found)[0]


def _yaw_error_deg(T_map_sensor: Matrix, T_map_found: Matrix) -> float:
    """The twist about z of the rotation between them, without the tilt."""
    _, _, z, w = quaternion_of(T_map_found @ inverse(T_map_sensor))
    return abs(float(np.degrees(2 * np.arctan2(z, w))))


def _share(flags: Sequence[bool]) -> float:
    return float(np.mean(flags)) if flags else 0.0
