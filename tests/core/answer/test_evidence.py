import numpy as np
import pytest

from firstfix.answer.fit import MOST_MARGIN, Fit, evidence

TIED = 0.05


def test_support_falls_with_every_wall_that_is_seen_through():
    assert Fit(0.9, 0.8, 0.0).support == 0.8
    assert Fit(0.9, 0.8, 0.1).support == pytest.approx(0.6)
    assert Fit(0.9, 0.8, 0.3).support == Fit(0.9, 0.8, 0.9).support  # more than a fifth is no worse


def test_the_margin_is_over_the_best_other_place():
    fits = [Fit(0.9, 0.8, 0.0), Fit(0.7, 0.5, 0.0), Fit(0.95, 0.7, 0.05)]
    assert evidence(fits, TIED).margin == pytest.approx(0.2)
    assert evidence(fits, TIED, 1).margin == pytest.approx(-0.3)
    assert evidence(fits[:1], TIED).margin == MOST_MARGIN


def test_places_that_tie_are_no_rivals_of_each_other():
    fits = [Fit(0.9, 0.8, 0.0), Fit(0.9, 0.78, 0.0), Fit(0.9, 0.76, 0.0), Fit(0.7, 0.5, 0.0)]
    assert [evidence(fits, TIED, place).tied for place in range(4)] == [3, 3, 3, 1]
    assert evidence(fits, TIED).margin == pytest.approx(0.3)
    assert evidence(fits[:3], TIED).margin == MOST_MARGIN
    assert evidence(fits, TIED, 3).margin == pytest.approx(-0.3)


@pytest.mark.parametrize(
    ("better", "worse"),
    [
        (Fit(0.95, 0.81, 0.01), Fit(0.95, 0.8, 0.01)),
        (Fit(0.95, 0.8, 0.0), Fit(0.95, 0.8, 0.01)),
    ],
)
def test_no_feature_falls_as_the_fit_gets_better(better, worse):
    assert (evidence([better], TIED).features >= evidence([worse], TIED).features).all()
    assert (evidence([better], TIED).features > evidence([worse], TIED).features).any()


@pytest.mark.parametrize("fit", [Fit(0.0, 0.0, 1.0), Fit(1.0, 1.0, 0.0)])
def test_features_are_finite_at_the_ends(fit):
    assert np.isfinite(evidence([fit, fit], TIED).features).all()
