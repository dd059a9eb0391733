"""The compiled formulas of the ranking, against plain ones on seeded qualities."""

from dataclasses import replace

import numpy as np
import pytest

from firstfix import native
from firstfix.answer.quality import AlignmentQuality
from firstfix.engine.calibration import Calibration
from firstfix.engine.ranking import RANKING, MatchFeatures
from tests.reference import ranking as reference

CALIBRATION = Calibration(among_tied=(-8.0, 1.0, 1.5, 2.0, 1.0, 9.0))


def qualities(count: int) -> list[AlignmentQuality]:
    rng = np.random.default_rng(5)
    made = [AlignmentQuality(*rng.uniform(0, 1, 6).tolist(), float(rng.uniform(0, 1))) for _ in range(count)]
    return [replace(one, seen_free=None) if number % 3 else one for number, one in enumerate(made)]


def test_support_and_contradiction_are_the_plain_ones():
    for one in qualities(50):
        assert RANKING.support(one) == pytest.approx(reference.support(RANKING, one), rel=1e-14)
        wanted = reference.contradiction(RANKING, one)
        assert RANKING.contradiction(one) == pytest.approx(wanted, rel=1e-13, abs=1e-15)


def test_a_motion_is_discounted_as_in_plain_python():
    rng = np.random.default_rng(6)
    for score, twist in zip(rng.uniform(0, 1, 50).tolist(), rng.normal(0, 3, (50, 6)), strict=True):
        wanted = reference.discounted_score(RANKING, score, twist)
        assert RANKING.discounted_score(score, twist) == pytest.approx(wanted, rel=1e-13)


@pytest.mark.parametrize("count", [1, 2, 3, 9])
def test_margin_and_ties_are_the_plain_ones(count: int):
    rng = np.random.default_rng(count)
    for _ in range(20):
        supports = rng.uniform(0, 0.3, count).tolist()
        number, within = int(rng.integers(count)), float(rng.uniform(0, 0.4))
        found = native.margin_and_tied(supports, number, within, 0.25)
        assert found == reference.margin_and_tied(supports, number, within, 0.25)


@pytest.mark.parametrize("tied", [1, 2])
def test_the_probability_is_the_plain_one(tied: int):
    for number, one in enumerate(qualities(50)):
        margin = number / 100 - 0.1
        found = CALIBRATION.probability(MatchFeatures(one, margin, tied))
        wanted = reference.probability(CALIBRATION, RANKING, one, margin, tied)
        assert found == pytest.approx(wanted, rel=1e-12)


def test_a_number_that_is_none_is_refused():
    with pytest.raises(ValueError, match="not finite"):
        RANKING.support(AlignmentQuality(0.5, float("nan"), 0.0))
    with pytest.raises(ValueError, match="no such pose"):
        native.margin_and_tied([0.1], 1, 0.05, 0.25)
