"""The motion during a scan at places that are compared: on a map of made-up alignments."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from firstfix.engine.ranking import RANKING
from firstfix.engine.registration.align import Registrations
from firstfix.engine.registration.surface import Surface
from firstfix.transform import make_transform, rotation_z
from tests.reference.motion_at_places import MotionAtPlaces

POINTS = np.zeros((4, 3), np.float32)
SCAN = Surface(POINTS, POINTS, np.zeros(4, np.bool_), np.linspace(0, 0.1, 4, dtype=np.float32))
TURNING = np.array([0, 0, 0, 0, 0, 2.0])
SLIDING = np.array([1.4, 1.3, 0, 0, 0, 2.0])  # a motion that only a poor minimum has
ASKEW = make_transform(rotation_z(0.1), [0, 0, 0])  # of the skewed scan, where it was aligned rigidly
REST = np.zeros((3, 6))


def at(x: float) -> np.ndarray:
    return make_transform(np.eye(3), [x, 0, 0])


def rigid(scores: list[float]) -> Registrations:
    """Registrations at x = 0, 10, 20, ..., each askew."""
    T = np.array([at(10.0 * number) @ ASKEW for number in range(len(scores))])
    score, count = np.array(scores), len(T)
    return Registrations(T, score, score, np.zeros((count, 6, 6)), np.ones(count, bool))


@dataclass
class MadeUpSurface:
    """From rest, place 1 ends in a poor minimum. From the true motion and pose, all end in the right one.

    Attributes:
        wrong: places that fit no motion well.
    """

    wrong: tuple[int, ...] = ()
    asked: list[tuple[int, bool]] = field(default_factory=list)  # number of the place, and whether from rest
    ranking = RANKING

    def align_fine(self, scan, starts, *, twist):
        assert scan is SCAN
        T, score, found = [], [], []
        for start, known in zip(starts, twist, strict=True):
            number = round(start[0, 3] / 10)
            self.asked.append((number, not known.any()))
            is_poor = number in self.wrong or (number == 1 and not known.any())
            if known.any():
                np.testing.assert_allclose(start, at(10.0 * number), atol=1e-9)
            T.append(at(10.0 * number + 0.2) if is_poor else at(10.0 * number))
            score.append(0.7 if is_poor else 0.9 - number / 100)
            found.append(SLIDING if is_poor else TURNING)
        count = len(starts)
        return Registrations(
            np.array(T).reshape(-1, 4, 4),
            np.array(score),
            np.array(score),
            np.zeros((count, 6, 6)),
            np.ones(count, bool),
            np.array(found).reshape(-1, 6),
        )


def test_a_rival_with_another_motion_is_solved_again_from_the_best():
    surface = MadeUpSurface()
    found = MotionAtPlaces(surface, SCAN, 0.85).solve(rigid([0.7, 0.68, 0.66]), REST, np.arange(3))
    assert surface.asked == [(0, True), (1, True), (2, True), (1, False)]  # the third has the same motion
    assert [one.T_level_sensor[0, 3] for one in found] == [0.0, 10.0, 20.0]
    assert all(np.array_equal(one.twist, TURNING) for one in found)


def test_a_place_that_fits_no_better_keeps_its_motion():
    surface = MadeUpSurface(wrong=(2,))
    motion = MotionAtPlaces(surface, SCAN, 0.85)
    found = motion.solve(rigid([0.7, 0.68, 0.66]), REST, np.arange(3))
    assert np.array_equal(found[2].twist, SLIDING)
    asked = len(surface.asked)
    assert motion.solve(rigid([0.7, 0.68, 0.66]), REST, np.arange(3)) == found
    assert len(surface.asked) == asked, "nothing is solved twice"


def test_a_hopeless_place_is_not_solved_again():
    surface = MadeUpSurface(wrong=(2,))
    MotionAtPlaces(surface, SCAN, 0.85).solve(rigid([0.7, 0.68, 0.5]), REST, np.arange(3))
    assert (2, False) not in surface.asked


def test_a_start_with_a_motion_is_solved_from_it():
    """So are the known aliases of a place: it was deskewed by the motion there."""
    surface, known = MadeUpSurface(), np.array([np.zeros(6), TURNING])
    given = rigid([0.7, 0.9])
    T = np.array([given.T_level_sensor[0], at(10.0)])
    aligned = Registrations(T, given.inlier_ratio, given.alignment_score, given.information, given.rests)
    motion = MotionAtPlaces(surface, SCAN, 0.85)
    found = motion.solve(aligned, known, np.arange(2))
    assert surface.asked == [(0, True), (1, False)]
    assert np.array_equal(found[1].twist, TURNING)
    np.testing.assert_array_equal(motion.T_level_sensor, [one.T_level_sensor for one in found])
