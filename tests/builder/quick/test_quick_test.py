"""The self-test of a provisional version: its threshold lies above every wrong place that it saw."""

from __future__ import annotations

import numpy as np
import pytest

from firstfix.answer.localization import Hypothesis, Localization, Reason, Verdict
from firstfix.answer.quality import AlignmentQuality
from firstfix.builds.config import BuildConfig
from firstfix.engine.calibration import Calibration
from firstfix.transform import make_transform
from firstfix_builder.quick.quick_test import judged
from firstfix_builder.self_test.outcome import Outcome

PERFECT, POOR = AlignmentQuality(0.99, 0.97, 0.0), AlignmentQuality(0.5, 0.3, 0.05)
HERE, ELSEWHERE = make_transform(np.eye(3), [0.1, 0, 0]), make_transform(np.eye(3), [20.0, 0, 0])
USUAL = Calibration().min_probability


def outcome(number: int, *places: tuple[np.ndarray, AlignmentQuality]) -> Outcome:
    found = tuple(Hypothesis(T, quality, 0.1, 0, "") for T, quality in places)
    answer = Localization(Verdict.REJECTED, (Reason.LOW_PROBABILITY,), hypotheses=found)
    return Outcome.here(number, answer, np.eye(4), np.eye(4))


def test_right_places_leave_the_threshold_and_the_prior_as_they_are():
    tested = judged([outcome(k, (HERE, PERFECT), (ELSEWHERE, POOR)) for k in range(12)], BuildConfig())
    assert tested.calibration == Calibration(), "its own points teach no surer answers"
    assert tested.report.queries == 12
    assert tested.report.found == 1.0
    assert tested.report.false_accepts == 0


def test_a_wrong_place_raises_the_threshold_above_it():
    wrong = outcome(0, (ELSEWHERE, PERFECT), (HERE, POOR))
    claimed = Calibration().probability(wrong.evidence)
    assert claimed > USUAL, "the prior alone would have said localized"
    tested = judged(
        [wrong, *(outcome(k, (HERE, PERFECT), (ELSEWHERE, POOR)) for k in range(1, 12))], BuildConfig()
    )
    assert tested.calibration.min_probability > claimed
    assert tested.calibration.search_until == tested.calibration.min_probability
    assert not wrong.accepted_by(tested.calibration)
    assert tested.report.false_accepts == 0
    assert tested.report.found == pytest.approx(11 / 12, abs=1e-4)


def test_a_scan_without_any_place_is_a_negative_that_no_threshold_accepts():
    tested = judged([outcome(0)], BuildConfig())
    assert tested.report.found == 0.0
    assert tested.bound.negatives == 1
    assert [row.accepted for row in tested.bound.rows] == [0] * len(tested.bound.rows)
    assert tested.bound.least == pytest.approx(0.95), "one scan shows next to nothing"
