"""What the self-test asks with priors, and what it learns of the answers."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from firstfix.answer.localization import Hypothesis, Localization, Verdict
from firstfix.answer.options import LocalizeOptions
from firstfix.answer.quality import AlignmentQuality
from firstfix.engine.calibration import Calibration
from firstfix.engine.with_prior import MAX_RADIUS_M, MIN_RADIUS_M
from firstfix.scan.scan import Scan
from firstfix.transform import make_transform
from firstfix_builder.self_test import prior_asks
from firstfix_builder.self_test.outcome import Outcome
from firstfix_builder.self_test.prior_asks import PriorAsks, PriorOutcome, teach_with_prior

HERE = make_transform(np.eye(3), [3.0, 4.0, 1.0])
TWIN = make_transform(np.diag([-1.0, -1.0, 1.0]), [37.0, 8.0, 1.0])
SCAN = Scan.from_points(np.ones((10, 3)))
MAX_FALSE_ACCEPT = 0.005


def answer(score: float, T_map_sensor=HERE, verdict=Verdict.LOCALIZED, beside=0.07) -> Localization:
    """Returns the answer of a bare hall: few planes, so a free query would not be sure of it."""
    quality = AlignmentQuality(score, score, 0.0, 0.0, beside, 0.25)
    pose = T_map_sensor if verdict is Verdict.LOCALIZED else None
    hypotheses = (Hypothesis(T_map_sensor, quality, 0.5, 0),)
    return Localization(verdict, T_map_sensor=pose, hypotheses=hypotheses)


def asked(count: int, seed: int = 1) -> list[PriorOutcome]:
    """Returns scans of a hall with right priors, and with wrong ones whose best places fit worse."""
    rng, found = np.random.default_rng(seed), []
    for query in range(count):
        right = answer(rng.uniform(0.82, 0.95))
        found.append(PriorOutcome(Outcome.here(query, right, HERE, np.eye(4))))
        wrong = Outcome.nowhere(query, answer(rng.uniform(0.3, 0.6), beside=0.15))
        found.append(PriorOutcome(wrong, behind=0.3))
    return found


@pytest.fixture
def taught():
    return teach_with_prior(asked(100), Calibration(), MAX_FALSE_ACCEPT)


def test_it_parts_right_priors_from_wrong_ones(taught):
    claimed = {True: [], False: []}
    for one in asked(100, seed=2):
        claimed[one.outcome.is_in_map].append(taught.calibration.probability(one.outcome.evidence))
    assert min(claimed[True]) > 0.95 > 0.8 > max(claimed[False])
    assert taught.report["found"] == 1.0
    assert (taught.report["right"], taught.report["wrong"]) == (100, 100)
    assert taught.calibration.min_probability == taught.report["min_probability"] == 0.995


def test_no_wrong_prior_is_accepted(taught):
    assert taught.report["false_accepts"] == 0
    wrong = [one.outcome for one in asked(100, seed=2) if not one.outcome.is_in_map]
    assert not any(one.accepted_by(taught.calibration) for one in wrong)


@pytest.mark.parametrize("as_good", [{"is_equal": True}, {"behind": 0.04}], ids=["equal", "it ties"])
def test_a_place_as_good_as_the_true_one_teaches_nothing(taught, as_good):
    twin = PriorOutcome(Outcome.nowhere(100, answer(0.95)), **{"behind": 0.3, **as_good})
    assert teach_with_prior([*asked(100), twin], Calibration(), MAX_FALSE_ACCEPT) == taught
    worse = replace(twin, behind=0.3, is_equal=False)
    strict = teach_with_prior([*asked(100), worse], Calibration(), MAX_FALSE_ACCEPT)
    evidence = worse.outcome.evidence
    assert strict.calibration.probability(evidence) < taught.calibration.probability(evidence)


def test_what_the_engine_refuses_is_counted_and_does_not_raise_the_threshold(taught):
    refused = PriorOutcome(Outcome.nowhere(100, answer(0.95)), behind=0.3, is_refused=True)
    found = teach_with_prior([*asked(100), refused], Calibration(), MAX_FALSE_ACCEPT)
    assert found.calibration.min_probability <= taught.calibration.min_probability
    assert found.report["wrong"] == 101
    assert found.report["false_accepts"] == 0


def test_its_poses_tie_as_those_of_other_queries_do():
    of_all = Calibration(min_margin=0.06, alias_margin=0.09)
    found = teach_with_prior(asked(30), of_all, MAX_FALSE_ACCEPT).calibration
    assert (found.min_margin, found.alias_margin) == (0.06, 0.09)


def test_without_answers_nothing_is_taught():
    assert teach_with_prior([], Calibration(), MAX_FALSE_ACCEPT) is None


class Engine:
    """Keeps the priors that it is asked with."""

    def __init__(self) -> None:
        self.priors, self.said = [], answer(0.9)
        templates = SimpleNamespace(position_m=np.array([[20.0, 6.0, 1.0]]))
        self.index = SimpleNamespace(T_map_level=np.eye(4), cascade=SimpleNamespace(templates=templates))

    def localize(self, scan: Scan, options: LocalizeOptions) -> Localization:
        self.priors.append(options.prior)
        return self.said


@pytest.fixture
def engine():
    return Engine()


@pytest.fixture
def asks(engine, monkeypatch):
    monkeypatch.setattr(prior_asks, "share_seen_alike", lambda *_: 0.5)
    return PriorAsks(engine, None, None, LocalizeOptions(), 20)


def free(query: int, *others: np.ndarray) -> Outcome:
    hypotheses = [answer(0.9, T).hypotheses[0] for T in (HERE, *others)]
    return Outcome.here(query, Localization(Verdict.AMBIGUOUS, hypotheses=tuple(hypotheses)), HERE, np.eye(4))


def test_the_right_prior_holds_the_true_pose_and_the_wrong_one_does_not(asks, engine):
    for query in range(40):
        assert [one.outcome.is_in_map for one in asks.outcomes(free(query), SCAN)] == [True, False]
    for right, wrong in zip(engine.priors[::2], engine.priors[1::2], strict=True):
        assert right.allows(HERE)
        assert np.linalg.norm(wrong.position_m - HERE[:3, 3]) > wrong.radius_m + 1
        assert MIN_RADIUS_M <= right.radius_m == wrong.radius_m <= MAX_RADIUS_M
    assert {prior.yaw_range_deg for prior in engine.priors} == {45.0, 180.0}


def test_a_wrong_prior_is_about_the_twin_only_where_the_heading_tells(asks, engine):
    for query in range(40):
        asks.outcomes(free(query, TWIN), SCAN)
    with_heading = [prior for prior in engine.priors[1::2] if prior.yaw_range_deg < 180]
    without = [prior for prior in engine.priors[1::2] if prior.yaw_range_deg == 180]
    assert all(np.linalg.norm(one.position_m - TWIN[:3, 3]) < one.radius_m for one in with_heading)
    assert not any(one.allows(TWIN) for one in with_heading)
    assert all(np.linalg.norm(one.position_m[:2] - [20, 6]) <= one.radius_m for one in without)


def test_a_strange_scan_has_wrong_priors_alone(asks, engine):
    strange = Outcome.nowhere(3, answer(0.6, TWIN))
    (only,) = asks.outcomes(strange, SCAN)
    assert not only.outcome.is_in_map
    (prior,) = engine.priors
    assert prior.allows(TWIN)


def test_what_is_refused_however_low_the_threshold_is_told(asks, engine):
    engine.said = answer(0.9, verdict=Verdict.REJECTED)
    assert all(one.is_refused for one in asks.outcomes(free(0), SCAN))
    engine.said = answer(0.3, verdict=Verdict.REJECTED)
    assert not any(one.is_refused for one in asks.outcomes(free(0), SCAN)), "it is only improbable"
