"""A fleet of robots in a hall that changes: its observations, and worlds that only seem changed."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from firstfix.scan.scan import Scan
from firstfix_builder.simulation.boxes import Boxes
from firstfix_builder.simulation.rays import Rays
from firstfix_builder.simulation.simulate import Simulator
from firstfix_builder.sources.patch.confirm import Change, PatchRule, confirmed_changes
from firstfix_builder.sources.patch.observation import Observation, seen_by
from tests.changed_hall import SENSOR, Hall, free_poses, standing, with_error

SeenAs = Callable[[NDArray[np.float32], NDArray[np.float64]], NDArray[np.float32]]
SIZE_M = (16.0, 11.0, 4.0)
DAY_S, HOUR_S = 86400.0, 3600.0
MONDAY_S = 20_000 * DAY_S
FIXED = standing(
    (3.0, 0.0, 0.0, 5.0, 0.8, 2.5),
    (10.0, 10.0, 0.0, 13.5, 11.0, 1.6),
    (0.0, 4.2, 0.0, 1.0, 6.0, 2.0),
    (7.4, 5.2, 0.0, 7.9, 5.7, 4.0),
    (15.2, 2.0, 0.0, 16.0, 4.5, 3.0),
)
RACK = standing((4.0, 7.5, 0.0, 6.5, 8.6, 2.2))  # stands where the map has it
MOVED = standing((11.0, 3.0, 0.0, 13.5, 4.1, 2.2))  # and here after it was moved
MAPPED = Hall(SIZE_M, Boxes.joined(FIXED, RACK))
CHANGED = Hall(SIZE_M, Boxes.joined(FIXED, MOVED))
WITH_BOTH = Hall(SIZE_M, Boxes.joined(FIXED, RACK, MOVED))


class Fleet:
    """Robots that drive through halls. Poses and noise are the same in every run.

    Args:
        halls: as the hall is at one time or another.
        all_of_them: the hall with the things of all times, whose free places are free at every time.
    """

    def __init__(
        self, seed: int = 3, halls: Sequence[Hall] = (MAPPED, CHANGED), all_of_them: Hall = WITH_BOTH
    ) -> None:
        self._rng = np.random.default_rng(seed)
        self._simulators = {id(hall): hall.simulator() for hall in (*halls, all_of_them)}
        self._all_of_them = all_of_them

    def drive(
        self,
        hall: Hall,
        robots: Sequence[str],
        times_s: Sequence[float],
        *,
        scans: int = 4,
        seen_as: SeenAs | None = None,
    ) -> list[Observation]:
        """So many scans of each robot at each time, at free places of this hall and of the mapped one.

        Args:
            seen_as: changes the points of a scan, given them and the pose.
        """
        found = []
        simulator = self._simulators[id(hall)]
        free = self._free(len(robots) * len(times_s) * scans)
        for robot in robots:
            for begun_s in times_s:
                for number in range(scans):
                    T = free.pop()
                    scan = hall.scan(simulator, T, self._rng, people=0.5)
                    if seen_as is not None:
                        scan = Scan.from_points(seen_as(scan.points, T))
                    at = with_error(T, self._rng)
                    found.append(Observation(robot, begun_s + 60.0 * number, scan, at))
        return found

    def _free(self, count: int) -> list[NDArray[np.float64]]:
        """Poses that are free in every hall."""
        every = free_poses(self._simulators[id(self._all_of_them)], SIZE_M, count, self._rng)
        return [np.asarray(one) for one in every]

    def glass(self, share: float) -> SeenAs:
        """Scans of a hall in which MOVED is of glass: this share of its rays returns, by the angle."""
        bare = Simulator(*Boxes.joined(MAPPED._shell(), FIXED, RACK).mesh())

        def through(points: NDArray[np.float32], T: NDArray[np.float64]) -> NDArray[np.float32]:
            at = points @ T[:3, :3].T + T[:3, 3]
            low, high = MOVED.centre_m - MOVED.half_m - 0.1, MOVED.centre_m + MOVED.half_m + 0.1
            on_it = ((at > low) & (at < high)).all(axis=1)
            if self._rng.random() < share:  # looked at from the front
                return points
            away_m = np.linalg.norm(points, axis=1)
            ranges = next(bare.ranges(T[None], SENSOR, Rays.of(points / away_m[:, None])))[0]
            return np.where(on_it[:, None], points / away_m[:, None] * ranges[:, None], points)

        return through


def days(*numbers: float, hour: float = 9.0) -> list[float]:
    """Times of days after a Monday."""
    return [MONDAY_S + number * DAY_S + hour * HOUR_S for number in numbers]


def changes_in(observations: Sequence[Observation]) -> list[Change]:
    """The changes that a fleet's observations confirm."""
    return confirmed_changes(seen_by(MAPPED.index, observations)[0])


def is_refused(observations: Sequence[Observation], **loosened: float) -> bool:
    """Returns whether no change is confirmed by the rule, though one is if these bars are lower."""
    seen, _ = seen_by(MAPPED.index, observations)
    assert confirmed_changes(seen, PatchRule(**loosened)), "the poison is none"  # type: ignore[arg-type]
    return not confirmed_changes(seen)
