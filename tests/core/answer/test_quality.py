import math

import numpy as np
import pytest

from firstfix.answer.quality import (
    ALIGNMENT_WEIGHT,
    BEST_SCORE,
    MAX_MARGIN,
    AlignmentQuality,
    match_features,
)

TIED = 0.05


def fit_of(support: float) -> AlignmentQuality:
    """A fit with this support, by its alignment score."""
    rest = AlignmentQuality(0.9, 0.05, 0.01, 0.01).support
    return AlignmentQuality(0.9, BEST_SCORE - math.exp((rest - support) / ALIGNMENT_WEIGHT), 0.01, 0.01)


def test_support_falls_with_every_wall_that_is_seen_through():
    free = AlignmentQuality(0.9, 0.8, 0.0, 0.0).support
    left = AlignmentQuality(0.9, 0.8, 0.0, 0.02).support
    contradicted = AlignmentQuality(0.9, 0.8, 0.02, 0.0).support
    assert contradicted < left < free  # what has left counts less than what cannot be
    assert AlignmentQuality(0.9, 0.8, 0.5, 0.0).support < AlignmentQuality(0.9, 0.8, 0.3, 0.0).support


def test_a_few_directions_seen_through_outweigh_surfaces_that_the_map_lacks():
    """Mapping missed surfaces: the true place aligns worse than its look-alike, but passes no wall."""
    true_place, look_alike = AlignmentQuality(0.8, 0.68, 0.0, 0.0), AlignmentQuality(0.9, 0.78, 0.004, 0.016)
    assert true_place.support > look_alike.support + TIED


def test_the_margin_is_over_the_best_other_place():
    fits = [fit_of(1.0), fit_of(0.6), fit_of(0.8)]
    assert match_features(fits, TIED).margin == pytest.approx(0.2)
    assert match_features(fits, TIED, 1).margin == pytest.approx(-0.4)
    assert match_features(fits[:1], TIED).margin == MAX_MARGIN


def test_places_that_tie_are_no_rivals_of_each_other():
    fits = [fit_of(1.0), fit_of(0.98), fit_of(0.96), fit_of(0.7)]
    assert [match_features(fits, TIED, number).tied for number in range(4)] == [3, 3, 3, 1]
    assert match_features(fits, TIED).margin == pytest.approx(0.3)
    assert match_features(fits, TIED, 3).margin == pytest.approx(-0.3)


def test_where_all_places_tie_no_margin_is_claimed():
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


def test_what_has_left_counts_among_places_only():
    here, elsewhere = AlignmentQuality(0.95, 0.8, 0.0, 0.0), AlignmentQuality(0.95, 0.8, 0.0, 0.1)
    assert (match_features([elsewhere], TIED).vector == match_features([here], TIED).vector).all()
    assert match_features([here, elsewhere], TIED).margin > TIED


def test_how_the_scan_agrees_does_not_change_the_ranking():
    plain, beside = AlignmentQuality(0.95, 0.8, 0.0), AlignmentQuality(0.95, 0.8, 0.0, 0.0, 0.3, 0.3)
    assert plain.support == beside.support


@pytest.mark.parametrize(
    "fit", [AlignmentQuality(0.0, 0.0, 1.0, 1.0, 1.0, 1.0), AlignmentQuality(1.0, 1.0, 0.0, 0.0, 0.0, 0.0)]
)
def test_features_are_finite_at_the_ends(fit):
    assert np.isfinite(match_features([fit, fit], TIED).vector).all()
