import numpy as np
import pytest

from firstfix.answer.quality import MAX_MARGIN, AlignmentQuality, match_features

TIED = 0.05


def test_support_falls_with_every_wall_that_is_seen_through():
    assert AlignmentQuality(0.9, 0.8, 0.0).support == 0.8
    assert AlignmentQuality(0.9, 0.8, 0.1).support == pytest.approx(0.6)
    assert (
        AlignmentQuality(0.9, 0.8, 0.3).support == AlignmentQuality(0.9, 0.8, 0.9).support
    )  # more than a fifth is no worse


def test_the_margin_is_over_the_best_other_place():
    fits = [
        AlignmentQuality(0.9, 0.8, 0.0),
        AlignmentQuality(0.7, 0.5, 0.0),
        AlignmentQuality(0.95, 0.7, 0.05),
    ]
    assert match_features(fits, TIED).margin == pytest.approx(0.2)
    assert match_features(fits, TIED, 1).margin == pytest.approx(-0.3)
    assert match_features(fits[:1], TIED).margin == MAX_MARGIN


def test_places_that_tie_are_no_rivals_of_each_other():
    fits = [
        AlignmentQuality(0.9, 0.8, 0.0),
        AlignmentQuality(0.9, 0.78, 0.0),
        AlignmentQuality(0.9, 0.76, 0.0),
        AlignmentQuality(0.7, 0.5, 0.0),
    ]
    assert [match_features(fits, TIED, number).tied for number in range(4)] == [3, 3, 3, 1]
    assert match_features(fits, TIED).margin == pytest.approx(0.3)
    assert match_features(fits[:3], TIED).margin == MAX_MARGIN
    assert match_features(fits, TIED, 3).margin == pytest.approx(-0.3)


@pytest.mark.parametrize(
    ("better", "worse"),
    [
        (AlignmentQuality(0.95, 0.81, 0.01), AlignmentQuality(0.95, 0.8, 0.01)),
        (AlignmentQuality(0.95, 0.8, 0.0), AlignmentQuality(0.95, 0.8, 0.01)),
    ],
)
def test_no_feature_falls_as_the_fit_gets_better(better, worse):
    assert (match_features([better], TIED).vector >= match_features([worse], TIED).vector).all()
    assert (match_features([better], TIED).vector > match_features([worse], TIED).vector).any()


@pytest.mark.parametrize("fit", [AlignmentQuality(0.0, 0.0, 1.0), AlignmentQuality(1.0, 1.0, 0.0)])
def test_features_are_finite_at_the_ends(fit):
    assert np.isfinite(match_features([fit, fit], TIED).vector).all()
