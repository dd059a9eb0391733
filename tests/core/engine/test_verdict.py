"""Verdicts of places: rivals, ties, thresholds, motion, and scans from several spots."""

from dataclasses import replace

import numpy as np
import pytest

from firstfix.answer.localization import Localization, Reason, Verdict
from firstfix.answer.options import LocalizeOptions
from firstfix.engine.calibration import Calibration
from firstfix.engine.config import EngineConfig, PreprocessConfig
from firstfix.engine.index import FreeSpaceShares, MapIndex
from firstfix.engine.preprocess import preprocess
from firstfix.engine.ranking import RANKING
from firstfix.engine.registered_candidate import RegisteredCandidate
from firstfix.engine.registration.align import Agreement, Registration
from firstfix.scan.scan import Scan
from firstfix.scan.sequence import ScanSequence
from firstfix.transform import make_transform
from tests.reference.verdict import decided, features_of
from tests.reference.verdict_in_steps import judge

CALIBRATION = Calibration(min_inlier_ratio=0.5)
T_MAP_LEVEL = make_transform(np.eye(3), [500000.0, 5400000.0, 0])
INDEX = MapIndex(EngineConfig(T_map_level=tuple(T_MAP_LEVEL.ravel())), CALIBRATION, None, None, None)


def place(number: int, inlier_ratio: float, through: float = 0.005) -> RegisteredCandidate:
    T_level_sensor = make_transform(np.eye(3), [10.0 * number, 0, 0])
    registration = Registration(T_level_sensor, inlier_ratio, inlier_ratio * 0.85, np.eye(6))
    return RegisteredCandidate(INDEX, "yard", number, registration, FreeSpaceShares(through, 0.0))


def judged(
    *places: RegisteredCandidate,
    calibration: Calibration = CALIBRATION,
    **options: object,
) -> Localization:
    """The answer, whose decision is the one of the reference."""
    index = replace(INDEX, calibration=calibration)
    ranked = [replace(place, index=index) for place in places]
    return judged_alike(ranked, LocalizeOptions(**options))


def judged_alike(ranked: list[RegisteredCandidate], options: LocalizeOptions) -> Localization:
    answer = judge(ranked, options)
    if ranked:
        reason, probability, shares = decided(ranked, options)
        assert answer.reasons == (() if reason is None else (reason,))
        assert answer.probability == probability
        assert [one.probability for one in answer.hypotheses] == shares
    return answer


def test_a_good_place_without_rivals_is_localized():
    places = [place(0, 0.95), place(1, 0.4, 0.1)]
    answer = judged(*places)
    assert answer.verdict is Verdict.LOCALIZED
    assert answer.reasons == ()
    features = RANKING.match_features([p.quality for p in places], CALIBRATION.min_margin)
    assert answer.probability == CALIBRATION.probability(features)


def unsettled(settled: RegisteredCandidate) -> RegisteredCandidate:
    """The place, if its alignment still moved."""
    return replace(settled, registration=replace(settled.registration, rests=False))


SURE = Calibration(bias=0, alignment_score=50, free_space=0, margin=0, min_margin=0.1)
DOUBTS = Calibration(bias=-28)


@pytest.mark.parametrize(
    ("places", "options", "verdict", "reasons"),
    [
        ([], {}, Verdict.REJECTED, (Reason.NO_CANDIDATE,)),
        ([unsettled(place(0, 0.95)), place(1, 0.4, 0.1)], {}, Verdict.REJECTED, (Reason.NOT_CONVERGED,)),
        (
            [place(0, 0.97, 0.001), place(1, 0.96, 0.2)],
            {},
            Verdict.LOCALIZED,
            (),
        ),  # the alias: through a wall
        ([place(0, 0.95, 0.15)], {}, Verdict.REJECTED, (Reason.FREE_SPACE_VIOLATION,)),
        ([place(0, 0.45)], {"min_probability": 0.0}, Verdict.REJECTED, (Reason.LOW_INLIER_RATIO,)),
        ([place(0, 0.6)], {"calibration": DOUBTS}, Verdict.REJECTED, (Reason.LOW_PROBABILITY,)),
        ([place(0, 0.6)], {"calibration": DOUBTS, "min_probability": 0.01}, Verdict.LOCALIZED, ()),
        (
            [place(0, 0.99), place(1, 0.95)],
            {"calibration": SURE},
            Verdict.AMBIGUOUS,
            (Reason.SEVERAL_PLACES,),
        ),
        ([place(0, 0.99), place(1, 0.80)], {"calibration": SURE}, Verdict.LOCALIZED, ()),
    ],
)
def test_a_verdict_has_its_reasons(places, options, verdict, reasons):
    answer = judged(*places, **options)
    assert (answer.verdict, answer.reasons) == (verdict, reasons)
    assert (answer.T_map_sensor is None) == (verdict is not Verdict.LOCALIZED)


def test_an_alias_makes_it_ambiguous_and_both_are_returned():
    answer = judged(place(0, 0.95), place(1, 0.94))
    assert (answer.verdict, answer.reasons) == (Verdict.AMBIGUOUS, (Reason.SEVERAL_PLACES,))
    assert [h.template for h in answer.hypotheses] == [0, 1]
    assert answer.hypotheses[0].probability == answer.hypotheses[1].probability == answer.probability / 2


def test_the_probability_of_a_tie_is_that_the_truth_is_among_them():
    alone = judged(place(0, 0.95), place(2, 0.5))
    tied = judged(place(0, 0.95), place(1, 0.95), place(2, 0.5))
    assert (tied.verdict, tied.reasons) == (Verdict.AMBIGUOUS, (Reason.SEVERAL_PLACES,))
    assert tied.probability == alone.probability
    assert sum(h.probability for h in tied.hypotheses) <= 1


def test_the_probability_of_a_tie_does_not_jump_where_a_place_ceases_to_tie():
    """The same scan in another encoding moves leads by some thousandths."""
    best, second = place(0, 0.9), place(1, 0.899)
    calibration = claiming(0.97, best, second, place(2, 0.88), place(3, 0.6))
    told = []
    for inlier_ratio in np.linspace(0.74, 0.88, 400):
        third = place(2, float(inlier_ratio))
        answer = judged(best, second, third, place(3, 0.6), calibration=calibration)
        assert answer.reasons == (Reason.SEVERAL_PLACES,)
        told.append((best.support - third.support, answer.probability))
    leads, probabilities = np.array(sorted(told)).T
    end = CALIBRATION.min_margin
    assert leads[0] < end - 0.02 < end + 0.02 < leads[-1], "it ties, and it does not"
    steps = np.abs(np.diff(probabilities))
    assert np.diff(leads).max() < 0.001
    assert steps.max() < np.ptp(probabilities) / 5
    assert np.ptp(probabilities) > 0.1, "it matters whether it ties"


def test_the_probability_of_a_tie_does_not_depend_on_which_place_leads():
    """Rounding moves the alignment score by a thousandth: two places tie, and either may lead."""
    calibration, other = claiming(0.9, place(0, 0.9), place(1, 0.9), place(2, 0.6)), place(2, 0.6)
    told = {}
    for more in (-0.001, 0.001):
        plain = place(0, 0.9 + more)
        beside = replace(place(1, 0.9), agreement=Agreement(0.0164, 0.0))
        ranked = sorted([plain, beside], key=lambda one: -one.support)
        answer = judged(*ranked, other, calibration=calibration)
        assert answer.reasons == (Reason.SEVERAL_PLACES,)
        told[answer.hypotheses[0].template] = answer.probability
    assert set(told) == {0, 1}, "another place leads"
    assert abs(told[0] - told[1]) < 0.02
    assert calibration.probability(RANKING.match_features([beside.quality, other.quality], 0.05)) < 0.7


def claiming(probability: float, *places: RegisteredCandidate) -> Calibration:
    """A calibration that gives the best of the places, or those that tie with it, this probability."""

    def log_odds(p: float) -> float:
        return float(np.log(p / (1 - p)))

    said = CALIBRATION.probability(
        RANKING.match_features([place.quality for place in places], CALIBRATION.min_margin)
    )
    return replace(CALIBRATION, bias=CALIBRATION.bias + log_odds(probability) - log_odds(said))


@pytest.mark.parametrize("options", [{}, {"min_probability": 0.9999}], ids=["the map's threshold", "its own"])
def test_places_that_tie_are_ambiguous_if_one_of_them_is_likely(options):
    tied = place(0, 0.8), place(1, 0.8), place(2, 0.5)
    answer = judged(*tied, calibration=claiming(0.6, *tied), **options)
    assert (answer.verdict, answer.reasons) == (Verdict.AMBIGUOUS, (Reason.SEVERAL_PLACES,))
    answer = judged(*tied, calibration=claiming(0.4, *tied), **options)
    assert (answer.verdict, answer.reasons) == (Verdict.REJECTED, (Reason.LOW_PROBABILITY,))


def test_one_place_has_to_be_surer_than_places_that_tie():
    alone = place(0, 0.8), place(2, 0.5)
    assert judged(*alone, calibration=claiming(0.6, *alone)).reasons == (Reason.LOW_PROBABILITY,)


@pytest.mark.parametrize(
    ("twist", "verdict"),
    [
        (np.zeros(6), Verdict.LOCALIZED),
        (np.array([0.1, 0, 0, 0, 0, 0.01]), Verdict.LOCALIZED),
        (np.array([0.5, 0, 0, 0, 0, 0]), Verdict.REJECTED),
        (np.array([0, 0, 0, 0, 0, 1.0]), Verdict.REJECTED),
    ],
    ids=["at rest", "hardly moving", "driving", "turning"],
)
def test_a_scan_in_motion_needs_more_than_many_maps_have_taught(twist, verdict):
    """They taught of scans at rest. It needs .997 to .999, as the map's own cases ask."""
    good = place(0, 0.95)
    moving = replace(good, registration=replace(good.registration, twist=twist))
    taught = replace(claiming(0.996, good), min_probability=0.99, search_until=0.9999)
    assert judged(moving, calibration=taught).verdict is verdict
    assert judged(moving, calibration=taught, min_probability=0.5).verdict is Verdict.LOCALIZED
    surer = replace(claiming(0.9992, good), min_probability=0.99, search_until=0.9999)
    assert judged(moving, calibration=surer).verdict is Verdict.LOCALIZED
    easy = replace(claiming(0.998, good), min_probability=0.99, search_until=0.99)
    assert judged(moving, calibration=easy).verdict is Verdict.LOCALIZED
    unsure = replace(claiming(0.996, good), min_probability=0.99, search_until=0.99)
    assert judged(moving, calibration=unsure).verdict is verdict


def test_poses_are_in_the_map_frame():
    T_base_sensor = make_transform(np.eye(3), [0, 0, 2.0])
    answer = judged(place(1, 0.95), T_base_sensor=T_base_sensor)
    assert answer.hypotheses[0].T_map_sensor[:3, 3].tolist() == [500010.0, 5400000.0, 0]
    assert answer.T_map_sensor[:3, 3].tolist() == [500010.0, 5400000.0, 0]
    assert answer.T_map_base[:3, 3].tolist() == [500010.0, 5400000.0, -2.0]
    assert answer.map_id == "yard"


def test_only_a_localized_answer_has_a_pose():
    assert judged(place(0, 0.95)).covariance.shape == (6, 6)
    for answer in (judged(place(0, 0.95), place(1, 0.94)), judged(place(0, 0.45))):
        assert (answer.T_map_sensor, answer.covariance, answer.map_id) == (None, None, "")


PLAIN = MapIndex(EngineConfig(), Calibration(), None, None, None)
BOX = Scan.from_points(np.random.default_rng(1).uniform(-1, 1, (4000, 3)) * [8, 6, 1.5])


def fit_at(x: float, score: float) -> RegisteredCandidate:
    T_level_sensor = make_transform(np.eye(3), [x, 0, 0])
    return RegisteredCandidate(PLAIN, "", 0, Registration(T_level_sensor, 0.95, score, np.eye(6)))


def test_the_margin_counts_once_for_each_spot():
    one = [fit_at(0, 0.9), fit_at(20, 0.8)]
    three = [replace(candidate, spots=3) for candidate in one]
    assert features_of(three).margin == pytest.approx(3 * features_of(one).margin)
    assert PLAIN.calibration.probability(features_of(three)) > PLAIN.calibration.probability(features_of(one))
    assert features_of(three, 1).margin == pytest.approx(3 * features_of(one, 1).margin), "a rival loses"


def test_places_that_tie_tie_from_any_number_of_spots():
    tied = [replace(fit_at(0, 0.9), spots=5), replace(fit_at(20, 0.89), spots=5)]
    assert features_of(tied).tied == 2


@pytest.mark.parametrize(
    ("ways_m", "spots"), [((0.0,), 1), ((0, 0.3, 0.6), 1), ((0, 2, 4), 3), ((0, 2, 0.2), 2)]
)
def test_spots_are_a_metre_apart(ways_m, spots):
    poses = [make_transform(np.eye(3), [x, 0, 0]) for x in ways_m]
    prepared = preprocess(ScanSequence.along([BOX] * len(poses), poses), None, PreprocessConfig())
    assert prepared is not None
    assert prepared.compiled.spots == spots


def any_place(rng: np.random.Generator, indices: list[MapIndex], spots: int) -> RegisteredCandidate:
    number = int(rng.integers(len(indices)))
    ratio = float(rng.choice([rng.uniform(0.3, 1), rng.uniform(0.93, 0.96)]))
    twist = None if rng.random() < 0.6 else rng.uniform(-0.5, 0.5, 6)
    registration = Registration(
        make_transform(np.eye(3), rng.uniform(-50, 50, 3)),
        ratio,
        0.9 * ratio,
        np.eye(6),
        bool(rng.random() < 0.9),
        twist,
    )
    shares = FreeSpaceShares(rng.choice([0.0, 0.005, 0.2]), rng.uniform(0, 0.1), rng.choice([None, 0.1]))
    agreement = Agreement(rng.uniform(0, 0.1), rng.uniform(0, 0.5))
    return RegisteredCandidate(
        indices[number],
        f"map {number}",
        0,
        registration,
        shares,
        agreement,
        spots=spots,
        is_alike=bool(rng.random() < 0.3),
        outside_lead=float(rng.choice([0.0, 0.0, 0.04, 0.2])),
    )


def test_any_places_of_several_maps_are_decided_upon_as_in_python():
    """Seeded chance makes the places: some tie, look alike, move, or are worse than one outside."""
    rng = np.random.default_rng(57)
    reasons = set()
    for _ in range(400):
        calibrations = [
            Calibration(
                bias=rng.uniform(-22, -8),
                min_probability=rng.uniform(0.5, 1),
                search_until=rng.uniform(0.5, 1),
                min_margin=rng.uniform(0.01, 0.1),
                among_tied=tuple(rng.uniform(0, 3, 6)) if rng.random() < 0.5 else (),
            )
            for _ in range(3)
        ]
        indices = [replace(PLAIN, calibration=one) for one in calibrations]
        spots = int(rng.integers(1, 4))
        ranked = [any_place(rng, indices, spots) for _ in range(rng.integers(1, 9))]
        ranked.sort(key=lambda one: -one.support)
        asked = LocalizeOptions(min_probability=None if rng.random() < 0.5 else rng.uniform(0, 1))
        reasons.update(judged_alike(ranked, asked).reasons or ("localized",))
    assert len(reasons) == 6, "every outcome of a decision was met"
