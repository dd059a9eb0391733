"""Localizes simulated scans of one session in the index of another session."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from firstfix.answer.localization import Verdict
from firstfix.answer.options import LocalizeOptions
from firstfix.errors import BuildCancelled
from firstfix.scan.scan import Scan
from firstfix.transform import Matrix, inverse, make_transform

from ...simulation.rays import Rays
from ...simulation.simulate import upright
from ...viewpoints.even_sample import rows_by_place
from .session_map import SessionMap

PLACES = 48
PLACE_M = 4.0  # edge of the cubes from which places are drawn in turn
RIVALS = 5  # hypotheses of one place that may vote
MIN_POINTS = 200  # of a scan
_DOWN = np.array([0.0, 0.0, -1.0])  # sessions are levelled


@dataclass(frozen=True)
class AskedPlace:
    """A place of the asked session, and its hypotheses in the other session's index.

    Attributes:
        position_m: (3,) in the asked session.
        T_known_asked: (k, 4, 4) transform between the two sessions by each hypothesis, best first.
        probability: (k,) of the hypotheses.
        localized: whether the verdict was ``localized``.
    """

    position_m: NDArray[np.float64]
    T_known_asked: NDArray[np.float64]
    probability: NDArray[np.float64]
    localized: bool


def scan_at(session: SessionMap, T_level_sensor: Matrix) -> NDArray[np.float32]:
    """(n, 3) clean returns of an upright sensor, in the sensor frame."""
    rays = Rays.at_any_heading(session.sensor)
    ranges = next(session.simulator.ranges(T_level_sensor[None], session.sensor, rays))[0]
    seen = np.isfinite(ranges)
    return rays.directions[seen] * ranges[seen, None]


def ask_places(
    asked: SessionMap,
    known: SessionMap,
    executor: Executor,
    cancelled: Callable[[], bool],
    *,
    count: int = PLACES,
) -> list[AskedPlace]:
    """Simulate scans at places all over one session, and localize them in the other session's index.

    Raises:
        BuildCancelled: cancelled() said so.
    """
    rows = rows_by_place(asked.position_m, count, PLACE_M)
    options = LocalizeOptions(gravity=_DOWN, T_base_sensor=np.eye(4))

    def ask(position_m: NDArray[np.float64]) -> AskedPlace | None:
        if cancelled():
            raise BuildCancelled("cancelled while sessions were aligned")
        T_asked_sensor = upright(position_m[None])[0]
        points = scan_at(asked, T_asked_sensor)
        if len(points) < MIN_POINTS:
            return None
        answer = known.localizer.localize(Scan.from_points(points), options)
        best = answer.hypotheses[:RIVALS]
        return AskedPlace(
            position_m,
            np.array(
                [known.T_level_map @ one.T_map_sensor @ inverse(T_asked_sensor) for one in best]
            ).reshape(-1, 4, 4),
            np.array([one.probability for one in best]),
            answer.verdict is Verdict.LOCALIZED,
        )

    return [place for place in executor.map(ask, asked.position_m[rows]) if place is not None]


def moved(T: Matrix, point_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """A (3,) point or (n, 3) points, transformed by T from its right frame to its left one."""
    found: NDArray[np.float64] = point_m @ T[:3, :3].T + T[:3, 3]
    return found


def translation(offset_m: NDArray[np.float64]) -> Matrix:
    """(4, 4) transform without a rotation."""
    return make_transform(np.eye(3), offset_m)
