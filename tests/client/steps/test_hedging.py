"""The time after which a second replica is asked."""

from __future__ import annotations

import pytest

from firstfix_client.policies import HedgePolicy
from firstfix_client.steps.send import ENOUGH, Hedging


def test_a_set_time_is_taken():
    hedging = Hedging(HedgePolicy(after_s=0.3))
    for _ in range(100):
        hedging.saw(0.001)
    assert hedging.after_s() == 0.3


def test_it_learns_what_answers_take():
    hedging = Hedging(HedgePolicy())
    for n in range(ENOUGH - 1):
        hedging.saw(0.05 + n / 1000)
        assert hedging.after_s() == 0.5
    for n in range(300):
        hedging.saw(n / 1000)  # the last 200: 0.1 to 0.299
    assert hedging.after_s() == pytest.approx(0.29)


def test_quick_answers_do_not_double_the_load():
    hedging = Hedging(HedgePolicy(min_after_s=0.02))
    for _ in range(100):
        hedging.saw(0.001)
    assert hedging.after_s() == 0.02
