"""Queries with a prior: a calibration of their own, and places outside that refute it."""

import json
from dataclasses import replace

import numpy as np
import pytest

from firstfix.answer.localization import Localization, Reason, Verdict
from firstfix.answer.options import LocalizeOptions
from firstfix.answer.prior import Prior
from firstfix.engine import localizer as localizer_module
from firstfix.engine.calibration import Calibration
from firstfix.engine.config import EngineConfig
from firstfix.engine.index import FreeSpaceShares, MapIndex
from firstfix.engine.localizer import Localizer
from firstfix.engine.registered_candidate import RegisteredCandidate
from firstfix.engine.registration.align import Registration
from firstfix.engine.stopwatch import Stopwatch
from firstfix.engine.with_prior import MAX_RADIUS_M, judging
from firstfix.transform import make_transform
from tests.reference.verdict import features_of
from tests.reference.verdict_in_steps import judge

TAUGHT = Calibration(bias=-15.0, min_probability=0.95, cases=200)
CALIBRATION = Calibration(cases=100, with_prior=TAUGHT)
INDEX = MapIndex(EngineConfig(), CALIBRATION, None, None, None)


def about(radius_m: float) -> Prior:
    return Prior(np.zeros(3), radius_m)


def test_a_prior_is_judged_by_a_calibration_of_its_own():
    assert judging(INDEX, LocalizeOptions(prior=about(2.5))).calibration == TAUGHT
    assert judging(INDEX, LocalizeOptions(prior=about(MAX_RADIUS_M))).calibration == TAUGHT


@pytest.mark.parametrize(
    "options",
    [
        LocalizeOptions(),
        LocalizeOptions(prior=about(MAX_RADIUS_M + 0.1)),
        LocalizeOptions(prior=about(2.5), max_false_accept=0.02),
    ],
    ids=["no prior", "a wide one", "a bound that was measured without priors"],
)
def test_other_questions_are_judged_without_it(options):
    assert judging(INDEX, options) is INDEX
    untaught = replace(INDEX, calibration=Calibration())
    assert judging(untaught, LocalizeOptions(prior=about(2.5))) is untaught


def test_a_stored_calibration_has_that_of_priors():
    stored = json.loads(json.dumps(CALIBRATION.to_mapping()))
    assert Calibration.from_mapping(stored) == CALIBRATION
    del stored["with_prior"]
    assert Calibration.from_mapping(stored) == replace(CALIBRATION, with_prior=None)
    assert "with_prior" not in TAUGHT.to_mapping()


def test_a_search_with_a_prior_asks_its_calibration(monkeypatch):
    monkeypatch.setattr(localizer_module, "MapSearch", lambda index, *given: index)

    def of_search(options: LocalizeOptions) -> Calibration:
        return Localizer(INDEX).search(None, options, Stopwatch()).calibration

    assert of_search(LocalizeOptions()) == CALIBRATION
    assert of_search(LocalizeOptions(prior=about(1.0))) == TAUGHT


ALIASED = MapIndex(EngineConfig(), Calibration(alias_margin=0.08), None, None, None)
NEAR = Prior(np.zeros(3), 2.5)


def fit_at(x: float, score: float) -> RegisteredCandidate:
    T_level_sensor = make_transform(np.eye(3), [x, 0, 0])
    registration = Registration(T_level_sensor, 0.97, score, np.eye(6))
    return RegisteredCandidate(ALIASED, "", 0, registration, FreeSpaceShares(0.0, 0.0))


def with_lead(lead: float) -> Localization:
    options = LocalizeOptions(prior=NEAR, min_probability=0.0)
    return judge([replace(fit_at(0, 0.95), outside_lead=lead)], options)


def test_a_tie_outside_leaves_it_to_the_prior():
    answer = with_lead(0.07)
    assert answer.verdict is Verdict.LOCALIZED
    assert answer.probability == with_lead(0.0).probability


def test_a_better_place_outside_refutes_the_prior():
    answer = with_lead(0.09)
    assert (answer.verdict, answer.reasons) == (Verdict.REJECTED, (Reason.LOW_PROBABILITY,))
    assert answer.probability < with_lead(0.07).probability
    assert features_of([replace(fit_at(0, 0.95), outside_lead=0.09)]).margin == -0.09
