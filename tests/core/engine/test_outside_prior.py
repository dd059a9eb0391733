"""A place outside a prior counts only if the scan fits it clearly better: then the prior is wrong."""

from dataclasses import replace

import numpy as np
import pytest

from firstfix.answer.localization import Localization, Reason, Verdict
from firstfix.answer.options import LocalizeOptions
from firstfix.answer.prior import Prior
from firstfix.engine.calibration import Calibration
from firstfix.engine.config import EngineConfig
from firstfix.engine.index import FreeSpaceShares, MapIndex
from firstfix.engine.outside_prior import lead_outside
from firstfix.engine.registered_candidate import RegisteredCandidate, features_of
from firstfix.engine.registration.align import Registration
from firstfix.engine.verdict import judge
from firstfix.transform import make_transform

INDEX = MapIndex(EngineConfig(), Calibration(alias_margin=0.08), None, None, None)
PRIOR = Prior(np.zeros(3), 2.5)


def place(x: float, score: float) -> RegisteredCandidate:
    T_level_sensor = make_transform(np.eye(3), [x, 0, 0])
    registration = Registration(T_level_sensor, 0.97, score, np.eye(6))
    return RegisteredCandidate(INDEX, "", 0, registration, FreeSpaceShares(0.0, 0.0))


def with_lead(lead: float) -> Localization:
    options = LocalizeOptions(prior=PRIOR, min_probability=0.0)
    return judge([replace(place(0, 0.95), outside_lead=lead)], options)


def test_one_that_ties_leaves_it_to_the_prior():
    answer = with_lead(0.07)
    assert answer.verdict is Verdict.LOCALIZED
    assert answer.probability == with_lead(0.0).probability


def test_a_better_one_refutes_the_prior_whatever_the_caller_takes():
    answer = with_lead(0.09)
    assert (answer.verdict, answer.reasons) == (Verdict.REJECTED, (Reason.LOW_PROBABILITY,))
    assert answer.probability < with_lead(0.07).probability
    assert features_of([replace(place(0, 0.95), outside_lead=0.09)]).margin == -0.09


def test_the_lead_is_that_of_the_best_place_outside():
    inside, outside = place(1, 0.9), place(20, 0.94)
    found = [place(-2, 0.97), outside, place(30, 0.8)]
    assert lead_outside(found, inside, PRIOR) == pytest.approx(outside.support - inside.support)
    assert lead_outside([place(20, 0.8)], inside, PRIOR) == 0.0
    assert lead_outside([], inside, PRIOR) == 0.0
