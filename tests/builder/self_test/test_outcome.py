"""Whether the place of a scan was found: it is the best one, or ties with it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from firstfix.answer.localization import Hypothesis, Localization, Reason, Verdict
from firstfix.answer.quality import AlignmentQuality
from firstfix.engine.calibration import Calibration
from firstfix.engine.ranking import RANKING
from firstfix.transform import make_transform
from firstfix_builder.self_test.outcome import Outcome

NEAR, FAR = make_transform(np.eye(3), [0.1, 0, 0]), make_transform(np.eye(3), [20.0, 0, 0])
TRUE = np.eye(4)
QUALITY = AlignmentQuality(0.95, 0.9, 0.0)
WORSE = AlignmentQuality(0.95, 0.87, 0.0)
APART = RANKING.support(QUALITY) - RANKING.support(WORSE)


def outcome(*places: tuple[np.ndarray, AlignmentQuality]) -> Outcome:
    found = tuple(Hypothesis(T, quality, 0.1, 0, "") for T, quality in places)
    answer = Localization(Verdict.REJECTED, (Reason.LOW_PROBABILITY,), hypotheses=found)
    return Outcome.here(0, answer, TRUE, np.eye(4))


def test_the_best_place_is_found_if_it_is_right():
    assert outcome((NEAR, QUALITY), (FAR, WORSE)).found_by(Calibration())
    assert not outcome((FAR, QUALITY)).found_by(Calibration())
    assert not outcome().found_by(Calibration())


def test_a_right_place_below_the_best_is_found_if_it_ties():
    second = replace(outcome((FAR, QUALITY), (NEAR, WORSE)), min_margin=0.9 * APART)
    assert not second.found_by(Calibration())
    assert replace(second, min_margin=1.1 * APART).found_by(Calibration()), "an equal storey"


def test_a_right_place_below_the_best_is_found_if_it_is_a_known_alias():
    alias = replace(outcome((FAR, QUALITY), (NEAR, WORSE)), min_margin=0.5 * APART, aliases=(1,))
    assert alias.found_by(Calibration(alias_margin=1.1 * APART))
    assert not alias.found_by(Calibration(alias_margin=0.9 * APART))
