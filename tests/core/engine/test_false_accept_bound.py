"""Bounds on false accepts: exact, monotone, kept in simulation, and what a query makes of them."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import beta, binom

from firstfix.answer.options import LocalizeOptions
from firstfix.engine.calibration import Calibration
from firstfix.engine.config import EngineConfig
from firstfix.engine.false_accept_bound import (
    FILE_NAME,
    THRESHOLDS,
    FalseAcceptBound,
    upper_bound,
)
from firstfix.engine.index import MapIndex
from firstfix.engine.verdict import threshold_of
from firstfix.errors import InvalidOption

INDEX = MapIndex(EngineConfig(), Calibration(), None, None, None)


def drawn(seed: int, count: int = 400) -> FalseAcceptBound:
    return FalseAcceptBound.of(np.random.default_rng(seed).beta(0.3, 6, count))


def test_bounds_are_the_beta_quantiles_of_clopper_and_pearson():
    for negatives in (1, 2, 30, 300, 5000):
        for accepted in {0, negatives // 3, negatives - 1}:
            wanted = beta.ppf(0.95, accepted + 1, negatives - accepted)
            found = upper_bound(accepted, negatives)
            assert wanted <= found <= wanted + 1e-6
            # the definition: so few would be accepted with a chance of 5 %
            assert binom.cdf(accepted, negatives, found) == pytest.approx(0.05, abs=2e-3)
    assert upper_bound(0, 0) == upper_bound(7, 7) == 1.0


def test_the_rows_count_what_each_threshold_accepts():
    found = FalseAcceptBound.of([0.5, 0.949, 0.95, 0.9999, -1.0, -1.0])
    assert found.negatives == 6
    assert [row.min_probability for row in found.rows] == list(THRESHOLDS)
    assert [row.accepted for row in found.rows] == [4, 3, 3, 2, 1, 1, 1, 1, 1, 1]


@pytest.mark.parametrize("seed", range(20))
def test_a_higher_threshold_has_a_lower_bound(seed: int):
    found = drawn(seed)
    bounds = [row.bound for row in found.rows]
    assert bounds == sorted(bounds, reverse=True)
    assert found.least == bounds[-1]
    asked = np.sort(np.random.default_rng(seed).uniform(found.least, 1, 50))
    chosen = [found.min_probability(share) for share in asked.tolist()]
    assert chosen == sorted(chosen, reverse=True)
    for share, threshold in zip(asked.tolist(), chosen, strict=True):
        below = [row for row in found.rows if row.min_probability < threshold]
        assert next(row.bound for row in found.rows if row.min_probability == threshold) <= share
        assert all(row.bound > share for row in below)


def test_a_promise_is_kept_in_nineteen_of_twenty_maps():
    """Negatives of known rates; a promise is broken where the chosen threshold accepts a larger share."""
    share = 0.02
    rates = np.array([0.3, 0.1, 0.05, 0.03, 0.021, 0.0105, 0.005, 0.004, 0.003, 0.002])  # of THRESHOLDS
    rng, broken = np.random.default_rng(5), 0
    claims, chances = np.array([0.0, *THRESHOLDS]), -np.diff([1.0, *rates, 0.0])
    for _ in range(2000):
        found = FalseAcceptBound.of(rng.choice(claims, 360, p=chances))
        if found.least <= share:
            broken += rates[THRESHOLDS.index(found.min_probability(share))] > share
    assert 0 < broken / 2000 < 0.05


def test_an_unreachable_bound_is_refused_with_the_least_one():
    found = drawn(1)
    with pytest.raises(InvalidOption, match=str(found.least)):
        found.min_probability(found.least / 2)
    with pytest.raises(InvalidOption, match="map hall"):
        found.min_probability(0.0, "hall")
    with pytest.raises(InvalidOption, match="build it again"):
        FalseAcceptBound().min_probability(0.5)
    assert FalseAcceptBound().least == 1.0


def test_a_bound_is_read_from_its_json(tmp_path: Path):
    found = drawn(2)
    (tmp_path / FILE_NAME).write_text(json.dumps(found.to_mapping()))
    assert FalseAcceptBound.load(tmp_path) == found
    assert FalseAcceptBound.load(tmp_path / "an old version") == FalseAcceptBound()


@pytest.mark.parametrize("damage", ["order", "bound", "row", "range"])
def test_damaged_bounds_are_refused(damage: str):
    data = drawn(3).to_mapping()
    rows = data["rows"]
    if damage == "order":
        rows.reverse()
    elif damage == "bound":
        rows[0]["bound"], rows[-1]["bound"] = 0.0, 0.9
    elif damage == "row":
        del rows[2]["bound"]
    else:
        rows[0]["bound"] = float("nan")
    with pytest.raises((ValueError, KeyError)):
        FalseAcceptBound.from_mapping(data)


def test_a_query_gets_the_threshold_of_the_map_that_answers():
    strict = replace(INDEX, false_accept_bound=FalseAcceptBound.of([0.96] * 3 + [-1] * 397))
    lax = replace(INDEX, false_accept_bound=FalseAcceptBound.of([-1] * 400))
    asked = LocalizeOptions(max_false_accept=0.01)
    assert threshold_of(strict, asked) == 0.98
    assert threshold_of(lax, asked) == THRESHOLDS[0]
    assert threshold_of(strict, LocalizeOptions(min_probability=0.7)) == 0.7
    assert threshold_of(INDEX, LocalizeOptions()) is None
    with pytest.raises(InvalidOption, match="build it again"):
        threshold_of(INDEX, asked)
    with pytest.raises(InvalidOption, match="give one"):
        threshold_of(lax, LocalizeOptions(min_probability=0.7, max_false_accept=0.1))


def test_the_options_text_takes_one_threshold():
    asked = LocalizeOptions.from_strings({"max_false_accept": "0.01"})
    assert asked.max_false_accept == 0.01
    assert asked.to_strings() == {"max_false_accept": "0.01"}
    for wrong in ("2", "-0.1", "nan", "much"):
        with pytest.raises(InvalidOption, match="max_false_accept"):
            LocalizeOptions.from_strings({"max_false_accept": wrong})
    with pytest.raises(InvalidOption, match="give one"):
        LocalizeOptions.from_strings({"max_false_accept": "0.01", "min_probability": "0.9"})
