"""The evidence of scans from several spots adds up; scans of one spot count once."""

from dataclasses import replace

import numpy as np
import pytest

from firstfix.engine.calibration import Calibration
from firstfix.engine.config import EngineConfig, PreprocessConfig
from firstfix.engine.index import MapIndex
from firstfix.engine.preprocess import preprocess, spots_of
from firstfix.engine.ranking import RANKING
from firstfix.engine.registered_candidate import RegisteredCandidate, features_of
from firstfix.engine.registration.align import Registration
from firstfix.scan.scan import Scan
from firstfix.scan.sequence import ScanSequence
from firstfix.transform import make_transform

INDEX = MapIndex(EngineConfig(), Calibration(), None, None, None)
BOX = Scan.from_points(np.random.default_rng(1).uniform(-1, 1, (4000, 3)) * [8, 6, 1.5])


def place(x: float, score: float) -> RegisteredCandidate:
    T_level_sensor = make_transform(np.eye(3), [x, 0, 0])
    return RegisteredCandidate(INDEX, "", 0, Registration(T_level_sensor, 0.95, score, np.eye(6)))


def test_the_margin_counts_once_for_each_spot():
    one = [place(0, 0.9), place(20, 0.8)]
    three = [replace(candidate, spots=3) for candidate in one]
    assert features_of(three).margin == pytest.approx(3 * features_of(one).margin)
    assert INDEX.calibration.probability(features_of(three)) > INDEX.calibration.probability(features_of(one))
    assert features_of(three, 1).margin == pytest.approx(3 * features_of(one, 1).margin), "a rival loses"


def test_places_that_tie_tie_from_any_number_of_spots():
    tied = [replace(place(0, 0.9), spots=5), replace(place(20, 0.89), spots=5)]
    assert features_of(tied).tied == 2


@pytest.mark.parametrize(
    ("ways_m", "spots"), [((0.0,), 1), ((0, 0.3, 0.6), 1), ((0, 2, 4), 3), ((0, 2, 0.2), 2)]
)
def test_spots_are_a_metre_apart(ways_m, spots):
    poses = [make_transform(np.eye(3), [x, 0, 0]) for x in ways_m]
    prepared = preprocess(ScanSequence.along([BOX] * len(poses), poses), None, PreprocessConfig())
    assert prepared is not None
    assert spots_of(prepared.scans, RANKING.spots_apart_m) == spots
