import numpy as np
import pytest

from firstfix.calibration import Calibration


def cases(n: int, seed: int):
    rng = np.random.default_rng(seed)
    overlap, margin = rng.uniform(0.2, 1, n), rng.uniform(-0.1, 0.5, n)
    truth = rng.random(n) < 1 / (1 + np.exp(-(-8 + 10 * overlap + 12 * margin)))
    return overlap, margin, truth


def test_probabilities_match_frequencies_on_new_cases():
    fitted = Calibration.fit(*cases(20_000, 1))
    overlap, margin, truth = cases(20_000, 2)
    claimed = np.array([fitted.probability(o, m) for o, m in zip(overlap, margin, strict=True)])
    bins = np.minimum((claimed * 10).astype(int), 9)
    error = sum(
        abs(claimed[bins == b].mean() - truth[bins == b].mean()) * np.mean(bins == b)
        for b in range(10)
        if (bins == b).any()
    )
    assert error < 0.02


def test_separable_cases_do_not_run_away():
    overlap = np.array([0.9, 0.95, 0.92, 0.3, 0.4])
    fitted = Calibration.fit(overlap, overlap - 0.2, overlap > 0.5)
    assert fitted.probability(0.93, 0.7) > 0.9
    assert fitted.probability(0.35, 0.1) < 0.1
    assert max(abs(fitted.bias), fitted.overlap, fitted.margin) < 100


def test_more_evidence_is_never_less_likely():
    rng = np.random.default_rng(0)
    fitted = Calibration.fit(rng.random(50), rng.random(50), rng.random(50) < 0.5)
    assert fitted.overlap >= 0
    assert fitted.margin >= 0


def test_no_cases_leave_the_prior():
    assert Calibration.fit([], [], []) == Calibration()


def test_round_trip():
    fitted = Calibration.fit(*cases(200, 3))
    assert Calibration.from_mapping(fitted.to_mapping()) == fitted
    assert fitted.cases == 200
    with pytest.raises(TypeError):
        Calibration.from_mapping({"nonsense": 1})
