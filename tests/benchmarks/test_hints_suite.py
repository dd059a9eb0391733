"""The hints suite: what is counted as resolved, and moves at random."""

import numpy as np
import pytest

from benchmarks.hints.follow import Followed, at_random
from benchmarks.hints.suite import Attempt, figures_of
from firstfix.answer.localization import Localization, Verdict
from firstfix.builds.config import PerturbConfig
from firstfix.sensor import preset
from firstfix.transform import make_transform
from firstfix_builder.simulation.perturb import ScanSimulation
from firstfix_builder.simulation.simulate import Simulator

RIGHT, WRONG = Followed(1, 0, True, False, (2.0,)), Followed(2, 1, False, True, (2.0, 4.0))
NOWHERE = Followed(0, 0, False, False, ())


def test_a_scan_without_a_hint_counts_as_not_resolved():
    found = [Attempt(True, True, 9.0, RIGHT, WRONG), Attempt(False, False, 11.0, NOWHERE, NOWHERE)]
    figures = figures_of(found)
    assert (figures["ambiguous"], figures["with_hint"], figures["blocked_ways"]) == (2, 1, 0)
    assert figures["all"] == {
        "n": 2,
        "hint": 0.5,
        "hint_where_given": 1.0,
        "hint_first_move": 0.5,
        "hint_wrong": 0,
        "random": 0.0,
        "random_where_given": 0.0,
        "random_wrong": 1,
    }
    assert figures["distinct"]["n"] == 1
    assert figures_of([])["all"]["hint"] is None


def test_a_random_move_is_as_long_as_the_hint_and_free_in_the_world():
    """A wall stands across the y axis: no way of 4 m leads through it."""
    vertices = np.array([[1, -50, -50], [1, 50, -50], [1, 0, 80.0]])
    world = Simulator(vertices, np.array([[0, 1, 2]]))
    simulation = ScanSimulation(world, preset("vlp-16"), PerturbConfig())
    choose = at_random(simulation, (4.0,) * 20, np.random.default_rng(1))
    answer = Localization(Verdict.AMBIGUOUS)
    goals = [choose(make_transform(np.eye(3), [0, 0, 0]), answer) for _ in range(20)]
    assert all(np.linalg.norm(T[:3, 3]) == pytest.approx(4.0) for T in goals)
    assert all(T[0, 3] < 1 for T in goals)
    assert choose(np.eye(4), answer) is None, "the hint made no more moves"
