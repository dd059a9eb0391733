import json
import math

import numpy as np
import pytest

from firstfix.answer.quality import AlignmentQuality
from firstfix.catalog.manifest import Manifest
from firstfix.engine.calibration import Calibration
from firstfix.engine.config import ENGINE_FILE, EngineConfig
from firstfix.engine.index import CALIBRATION_FILE, MapIndex
from firstfix.engine.ranking import RANKING, MatchFeatures, RankingConfig
from firstfix.errors import CorruptVersion, IncompatibleVersion

TIED = 0.05
CALIBRATION = Calibration()
support_of, match_features = RANKING.support, RANKING.match_features


def fit_of(support: float) -> AlignmentQuality:
    """A fit with this support, by its alignment score."""
    rest = support_of(AlignmentQuality(0.9, 0.05, 0.01, 0.01))
    return AlignmentQuality(
        0.9, RANKING.best_score - math.exp((rest - support) / RANKING.alignment_weight), 0.01, 0.01
    )


def test_support_falls_with_every_wall_that_is_seen_through():
    free = support_of(AlignmentQuality(0.9, 0.8, 0.0, 0.0))
    left = support_of(AlignmentQuality(0.9, 0.8, 0.0, 0.02))
    contradicted = support_of(AlignmentQuality(0.9, 0.8, 0.02, 0.0))
    assert contradicted < left < free  # what has left counts less than what cannot be
    assert support_of(AlignmentQuality(0.9, 0.8, 0.5, 0.0)) < support_of(AlignmentQuality(0.9, 0.8, 0.3, 0.0))


def test_a_few_directions_seen_through_outweigh_surfaces_that_the_map_lacks():
    """Mapping missed surfaces: the true place aligns worse than its look-alike, but passes no wall."""
    true_place, look_alike = AlignmentQuality(0.8, 0.68, 0.0, 0.0), AlignmentQuality(0.9, 0.78, 0.004, 0.016)
    assert support_of(true_place) > support_of(look_alike) + TIED


# A scan of a yard, turned: head down and below the floor next to nothing of it meets anything, so nothing
# contradicts it.
BELOW_THE_FLOOR = AlignmentQuality(0.0595, 0.0503, 0.0, 0.0187, 0.1556, 0.0593, 0.015)
IN_THE_YARD = AlignmentQuality(0.7254, 0.6439, 0.0056, 0.2352, 0.18, 0.0447, 0.04)


def test_what_the_scan_does_not_contradict_counts_only_as_far_as_it_meets_the_map():
    assert support_of(IN_THE_YARD) > support_of(BELOW_THE_FLOOR) + 0.25
    assert CALIBRATION.probability(MatchFeatures(BELOW_THE_FLOOR, RANKING.max_margin)) < 0.001
    assert CALIBRATION.probability(MatchFeatures(IN_THE_YARD, RANKING.max_margin)) > 0.9


def test_what_counts_for_a_pose_fades_without_a_step_as_it_meets_less():
    ratios = np.linspace(0.01, 0.6, 600)
    fits = [AlignmentQuality(float(ratio), 0.3, 0.0, 0.0, 0.05, 0.05) for ratio in ratios]
    supports = np.array([support_of(one) for one in fits])
    claimed = np.array([CALIBRATION.probability(MatchFeatures(one, 0.1)) for one in fits])
    assert (np.diff(supports) >= 0).all()
    assert np.diff(supports).max() < 0.003
    assert (np.diff(claimed) >= 0).all()
    assert np.ptp(supports[ratios > 0.4]) == 0, "from there on the walls agree, and all of it counts"


def test_the_margin_is_over_the_best_other_place():
    fits = [fit_of(1.0), fit_of(0.6), fit_of(0.8)]
    assert match_features(fits, TIED).margin == pytest.approx(0.2)
    assert match_features(fits, TIED, 1).margin == pytest.approx(-0.4)
    assert match_features(fits[:1], TIED).margin == RANKING.max_margin


def test_places_that_tie_are_no_rivals_of_each_other():
    fits = [fit_of(1.0), fit_of(0.98), fit_of(0.96), fit_of(0.7)]
    assert [match_features(fits, TIED, number).tied for number in range(4)] == [3, 3, 3, 1]
    assert match_features(fits, TIED).margin == pytest.approx(0.3)
    assert match_features(fits, TIED, 3).margin == pytest.approx(-0.3)


def test_known_aliases_tie_within_a_width_of_their_own():
    fits = [fit_of(1.0), fit_of(0.9), fit_of(0.86), fit_of(0.8), fit_of(0.6)]

    def tied(aliases: list[int], within: float) -> int:
        return match_features(fits, TIED, aliases=aliases, aliases_tied_within=within).tied

    assert tied([], 0.15) == 1
    assert tied([2], 0.15) == 3
    assert tied([2], 0.13) == 1
    assert tied([2, 4], 0.15) == 3
    assert match_features(fits, TIED, aliases=[2], aliases_tied_within=0.15).margin == pytest.approx(0.2)


def test_a_tie_of_all_places_has_no_margin():
    """The best rival was not compared: it may be as good as the weakest of those that tie."""
    fits = [fit_of(1.0), fit_of(0.98), fit_of(0.96)]
    assert match_features(fits, TIED).tied == 3
    assert match_features(fits, TIED).margin == pytest.approx(0.04)
    assert match_features(fits, TIED, 2).margin == pytest.approx(0.0)


@pytest.mark.parametrize(
    ("better", "worse"),
    [
        (AlignmentQuality(0.95, 0.81, 0.01), AlignmentQuality(0.95, 0.8, 0.01)),
        (AlignmentQuality(0.95, 0.8, 0.0), AlignmentQuality(0.95, 0.8, 0.01)),
        (AlignmentQuality(0.95, 0.8, 0.0, 0.0, 0.05), AlignmentQuality(0.95, 0.8, 0.0, 0.0, 0.06)),
        (AlignmentQuality(0.95, 0.8, 0.0, 0.0, 0.0, 0.1), AlignmentQuality(0.95, 0.8, 0.0, 0.0, 0.0, 0.2)),
    ],
)
def test_no_feature_falls_as_the_fit_gets_better(better, worse):
    assert (match_features([better], TIED).vector >= match_features([worse], TIED).vector).all()
    assert (match_features([better], TIED).vector > match_features([worse], TIED).vector).any()


def test_removed_surfaces_count_among_places_only():
    here, elsewhere = AlignmentQuality(0.95, 0.8, 0.0, 0.0), AlignmentQuality(0.95, 0.8, 0.0, 0.1)
    assert (match_features([elsewhere], TIED).vector == match_features([here], TIED).vector).all()
    assert match_features([here, elsewhere], TIED).margin > TIED


def test_how_the_scan_agrees_does_not_change_the_ranking():
    plain, beside = AlignmentQuality(0.95, 0.8, 0.0), AlignmentQuality(0.95, 0.8, 0.0, 0.0, 0.3, 0.3)
    assert support_of(plain) == support_of(beside)


@pytest.mark.parametrize(
    "fit", [AlignmentQuality(0.0, 0.0, 1.0, 1.0, 1.0, 1.0), AlignmentQuality(1.0, 1.0, 0.0, 0.0, 0.0, 0.0)]
)
def test_features_are_finite_at_the_ends(fit):
    assert np.isfinite(match_features([fit, fit], TIED).vector).all()


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


def test_a_calibration_is_read_from_its_mapping():
    fitted = Calibration.fit(*cases(200, 3))
    assert Calibration.from_mapping(fitted.to_mapping()) == fitted
    assert fitted.cases == 200
    with_ties = fitted.with_ties_as_in(Calibration.fit(*cases(200, 4)))
    assert Calibration.from_mapping(json.loads(json.dumps(with_ties.to_mapping()))) == with_ties
    with pytest.raises(ValueError, match="fields"):
        Calibration.from_mapping({**fitted.to_mapping(), "among_tied": [1.0, 2.0]})
    for other in ({"nonsense": 1}, {"bias": -12.0, "inlier_ratio": 18.0, "margin": 8.0}):
        with pytest.raises(IncompatibleVersion, match="rebuild"):
            Calibration.from_mapping(other)


def test_unmapped_points_count_less_against_a_place_than_points_beside_surfaces():
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


@pytest.mark.parametrize("name", RankingConfig.model_fields)
def test_each_number_is_part_of_the_version(tmp_path, name):
    own = EngineConfig().model_dump(mode="json")
    value = own["ranking"][name]
    other = json.loads(json.dumps(own))
    other["ranking"][name] = [2 * one for one in value] if isinstance(value, list) else value + 1
    (tmp_path / ENGINE_FILE).write_text(json.dumps(other))
    assert EngineConfig.load(tmp_path) != EngineConfig()
    assert Manifest({}, engine=other).digest != Manifest({}, engine=own).digest
    del other["ranking"][name]
    (tmp_path / ENGINE_FILE).write_text(json.dumps(other))
    with pytest.raises(IncompatibleVersion, match=f"{name}.*rebuild"):
        MapIndex.load(tmp_path)


def test_a_version_with_a_number_more_needs_a_rebuild_too(tmp_path):
    stored = EngineConfig().model_dump(mode="json")
    stored["ranking"]["echo_weight"] = 0.1
    (tmp_path / ENGINE_FILE).write_text(json.dumps(stored))
    with pytest.raises(IncompatibleVersion, match=r"echo_weight.*rebuild"):
        MapIndex.load(tmp_path)


def test_a_calibration_on_other_features_needs_a_rebuild(tmp_path):
    (tmp_path / ENGINE_FILE).write_text(EngineConfig().model_dump_json())
    fitted = Calibration().to_mapping()
    del fitted["same_plane"]
    (tmp_path / CALIBRATION_FILE).write_text(json.dumps(fitted))
    with pytest.raises(IncompatibleVersion, match=r"same_plane.*rebuild"):
        MapIndex.load(tmp_path)


@pytest.mark.parametrize("damaged", ["[]", "{", '{"ranking": 1}', '{"ranking": []}'])
def test_a_damaged_config_is_corrupt(tmp_path, damaged):
    (tmp_path / ENGINE_FILE).write_text(damaged)
    with pytest.raises((CorruptVersion, IncompatibleVersion)):
        MapIndex.load(tmp_path)
