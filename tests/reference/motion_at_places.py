"""The motion during a scan, solved at each place that is compared (docs/method.md section 7).

A scan has one motion, wherever it is compared. A place that fits worse than another may only have got a poor
minimum of its motion. So each that could rival the best one is solved again from the motion found there.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from firstfix.engine.registration.align import SLOW_M_S, SLOW_RAD_S, MapSurface, Registration, Registrations
from firstfix.engine.registration.surface import Surface
from firstfix.transform import Matrix, inverse


class MotionAtPlaces:
    """Registrations of one scan with its motion, row by row of the rigid ones. Each is solved once.

    Args:
        surface: of the map.
        scan: the few points of the query, with times.
        rival_from: share of the best place's rigid alignment score, from which on another may rival it.
    """

    def __init__(self, surface: MapSurface, scan: Surface, rival_from: float) -> None:
        self._surface, self._scan, self._rival_from = surface, scan, rival_from
        self._solved: dict[int, Registration] = {}
        self._compared: dict[int, NDArray[np.float64]] = {}  # twist of the best one, by row

    @property
    def T_level_sensor(self) -> NDArray[np.float64]:
        """Poses (k, 4, 4) of all that were solved."""
        return np.array([one.T_level_sensor for one in self._solved.values()]).reshape(-1, 4, 4)

    def solve(
        self, rigid: Registrations, twist_start: NDArray[np.float64], rows: NDArray[np.integer]
    ) -> list[Registration]:
        """Registrations with a motion, at the given rows, in order.

        Args:
            rigid: of the scan, deskewed by ``twist_start``.
            twist_start: (n, 6) with which the motion at a place begins.
        """
        new = np.array([row for row in rows.tolist() if row not in self._solved], np.int64)
        self._keep(new, rigid.T_level_sensor[new], twist_start[new])
        if len(rows) > 1:
            self._share_motion(rigid, twist_start, rows)
        return [self._solved[row] for row in rows.tolist()]

    def _share_motion(
        self, rigid: Registrations, twist_start: NDArray[np.float64], rows: NDArray[np.integer]
    ) -> None:
        """Solve the rows that may rival the best one again, beginning with its motion."""
        best = max(rows.tolist(), key=lambda row: self._score(self._solved[row]))
        found = self._solved[best]
        assert found.twist is not None
        least = self._rival_from * rigid.alignment_score[best]
        # the same skewed scan stood askew in the same way
        askew: Matrix = inverse(rigid.T_level_sensor[best]) @ found.T_level_sensor
        rivals = [
            row
            for row in rows.tolist()
            if row != best
            and rigid.alignment_score[row] >= least
            and np.array_equal(twist_start[row], twist_start[best])
            and not _is_same(self._solved[row].twist, found.twist)
            and not _is_same(self._compared.get(row), found.twist)
        ]
        self._compared.update((row, found.twist) for row in rivals)
        again = np.array(rivals, np.int64)
        self._keep(again, rigid.T_level_sensor[again] @ askew, np.tile(found.twist, (len(again), 1)))

    def _keep(
        self, rows: NDArray[np.int64], T_level_sensor: NDArray[np.float64], twist: NDArray[np.float64]
    ) -> None:
        """Solve rows from their (k, 4, 4) starts, and keep what is better than what they have."""
        for row, one in zip(
            rows.tolist(), self._surface.align_fine(self._scan, T_level_sensor, twist=twist), strict=True
        ):
            known = self._solved.get(row)
            if known is None or self._score(one) > self._score(known):
                self._solved[row] = one

    def _score(self, one: Registration) -> float:
        return self._surface.ranking.discounted_score(one.alignment_score, one.twist)


def together(registrations: Iterable[Registration]) -> NDArray[np.float64] | None:
    """Twists (k, 6) of registrations, or None: the scan's motion is not solved."""
    twists = [one.twist for one in registrations if one.twist is not None]
    return np.array(twists) if twists else None


def _is_same(one: NDArray[np.float64] | None, other: NDArray[np.float64]) -> bool:
    """Whether two motions differ by one that is slow."""
    if one is None:
        return False
    off = one - other
    return bool(np.linalg.norm(off[:3]) < SLOW_M_S and np.linalg.norm(off[3:]) < SLOW_RAD_S)
