import json

import numpy as np
import pytest

from firstfix.answer.quality import AlignmentQuality, MatchFeatures
from firstfix.engine.ranking import Calibration


def cases(n: int, seed: int):
    """Match features, and whether the pose was right, drawn from a model of the calibration's own kind."""
    rng = np.random.default_rng(seed)
    found = [
        MatchFeatures(AlignmentQuality(inlier_ratio, inlier_ratio * 0.8, through, 0.0, beside, same), margin)
        for inlier_ratio, through, beside, same, margin in zip(
            rng.uniform(0.3, 1, n),
            rng.exponential(0.05, n).clip(0, 1),
            rng.exponential(0.1, n).clip(0, 1),
            rng.uniform(0, 0.3, n),
            rng.uniform(-0.1, 0.5, n),
            strict=True,
        )
    ]
    true_model = Calibration(
        bias=-14.0, alignment_score=2.0, free_space=1.5, beside_surface=1.5, same_plane=0.8, margin=5.0
    )
    truth = rng.random(n) < [true_model.probability(e) for e in found]
    return found, truth, np.ones(n)


def test_probabilities_match_frequencies_on_new_cases():
    fitted = Calibration.fit(*cases(10_000, 1))
    found, truth, _ = cases(10_000, 2)
    claimed = np.array([fitted.probability(e) for e in found])
    bins = np.minimum((claimed * 10).astype(int), 9)
    error = sum(
        abs(claimed[bins == b].mean() - truth[bins == b].mean()) * np.mean(bins == b)
        for b in range(10)
        if (bins == b).any()
    )
    assert error < 0.02


def test_separable_cases_do_not_run_away():
    inlier_ratio = np.array([0.9, 0.95, 0.92, 0.3, 0.4])
    found = [MatchFeatures(AlignmentQuality(o, o * 0.8, 1 - o), o - 0.4) for o in inlier_ratio]
    fitted = Calibration.fit(found, inlier_ratio > 0.5, np.ones(5))
    assert fitted.probability(found[0]) > 0.9
    assert fitted.probability(found[3]) < 0.1
    assert np.abs(fitted.weights).max() < 200


def test_more_evidence_is_never_less_likely():
    found, _, weight = cases(60, 5)
    fitted = Calibration.fit(found, np.random.default_rng(0).random(60) < 0.5, weight)
    assert (fitted.weights[1:] >= 0).all()


def test_a_case_s_weight_is_how_often_it_counts():
    found, truth, _ = cases(300, 6)
    weight = np.where(truth, 1.0, 3.0)
    repeated = [e for e, w in zip(found, weight, strict=True) for _ in range(int(w))]
    repeated_truth = [t for t, w in zip(truth, weight, strict=True) for _ in range(int(w))]
    once = Calibration.fit(found, truth, weight)
    often = Calibration.fit(repeated, repeated_truth, np.ones(len(repeated)))
    assert once.weights == pytest.approx(often.weights, rel=1e-2, abs=1e-2)


def test_no_cases_leave_the_prior():
    assert Calibration.fit([], [], []) == Calibration()


def test_round_trip():
    fitted = Calibration.fit(*cases(200, 3))
    assert Calibration.from_mapping(fitted.to_mapping()) == fitted
    assert fitted.cases == 200
    with_ties = fitted.with_ties_as_in(Calibration.fit(*cases(200, 4)))
    assert Calibration.from_mapping(json.loads(json.dumps(with_ties.to_mapping()))) == with_ties
    earlier = fitted.to_mapping()
    del earlier["among_tied"]
    assert Calibration.from_mapping(earlier) == fitted
    for wrong in (
        {**fitted.to_mapping(), "among_tied": [1.0, 2.0]},
        {"nonsense": 1},
        {"bias": -12.0, "inlier_ratio": 18.0, "margin": 8.0},
    ):
        with pytest.raises(ValueError, match="fields"):
            Calibration.from_mapping(wrong)


def test_what_the_map_may_lack_speaks_less_against_a_place_than_what_stands_beside_its_surfaces():
    """Half of a scan on nothing: in a room that was missed, or in another building of the same kind."""
    missed = MatchFeatures(AlignmentQuality(0.7, 0.6, 0.0, 0.0, 0.02, 0.03), 0.25)
    alike = MatchFeatures(AlignmentQuality(0.7, 0.6, 0.0, 0.0, 0.2, 0.03), 0.25)
    bare = MatchFeatures(AlignmentQuality(0.7, 0.6, 0.0, 0.0, 0.02, 0.25), 0.25)
    calibration = Calibration()
    assert calibration.accepts(missed)
    assert not calibration.accepts(alike)
    assert not calibration.accepts(bare)


def test_accepting_takes_overlap_margin_and_probability():
    calibration = Calibration(min_inlier_ratio=0.5, min_margin=0.1)
    good = MatchFeatures(AlignmentQuality(0.97, 0.85, 0.0), 0.4)
    assert calibration.accepts(good)
    assert not calibration.accepts(MatchFeatures(good.quality, 0.4, tied=2))
    assert not calibration.accepts(MatchFeatures(AlignmentQuality(0.49, 0.85, 0.0), 0.4), min_probability=0.0)
    doubtful = MatchFeatures(AlignmentQuality(0.7, 0.6, 0.02, 0.02, 0.2, 0.2), 0.1)
    assert not calibration.accepts(doubtful)
    assert calibration.accepts(doubtful, min_probability=0.0)
