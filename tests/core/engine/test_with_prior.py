"""Queries with a prior are judged by a calibration of their own."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from firstfix.answer.options import LocalizeOptions
from firstfix.answer.prior import Prior
from firstfix.engine.calibration import Calibration
from firstfix.engine.config import EngineConfig
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer
from firstfix.engine.stopwatch import Stopwatch
from firstfix.engine.with_prior import MOST_RADIUS_M, judging

TAUGHT = Calibration(bias=-15.0, min_probability=0.95, cases=200)
CALIBRATION = Calibration(cases=100, with_prior=TAUGHT)
INDEX = MapIndex(EngineConfig(), CALIBRATION, None, None, None)


def about(radius_m: float) -> Prior:
    return Prior(np.zeros(3), radius_m)


def test_a_prior_asks_another_question():
    assert judging(INDEX, LocalizeOptions(prior=about(2.5))).calibration == TAUGHT
    assert judging(INDEX, LocalizeOptions(prior=about(MOST_RADIUS_M))).calibration == TAUGHT


@pytest.mark.parametrize(
    "options",
    [
        LocalizeOptions(),
        LocalizeOptions(prior=about(MOST_RADIUS_M + 0.1)),
        LocalizeOptions(prior=about(2.5), max_false_accept=0.02),
    ],
    ids=["no prior", "a wide one", "a bound that was measured without priors"],
)
def test_these_do_not(options):
    assert judging(INDEX, options) is INDEX


def test_a_version_that_has_learned_nothing_of_priors_judges_all_alike():
    index = replace(INDEX, calibration=Calibration())
    assert judging(index, LocalizeOptions(prior=about(2.5))) is index


def test_the_stored_calibration_has_both():
    stored = json.loads(json.dumps(CALIBRATION.to_mapping()))
    assert Calibration.from_mapping(stored) == CALIBRATION
    del stored["with_prior"]
    assert Calibration.from_mapping(stored) == replace(CALIBRATION, with_prior=None)
    assert "with_prior" not in TAUGHT.to_mapping()


def test_a_search_with_a_prior_asks_it():
    localizer = Localizer(INDEX)

    prepared = SimpleNamespace(scans=(), sparse=SimpleNamespace(time_s=None))

    def of_search(options: LocalizeOptions) -> Calibration:
        return localizer.search(prepared, options, Stopwatch(np.inf))._index.calibration

    assert of_search(LocalizeOptions()) == CALIBRATION
    assert of_search(LocalizeOptions(prior=about(1.0))) == TAUGHT
