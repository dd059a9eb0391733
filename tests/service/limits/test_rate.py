from __future__ import annotations

import pytest

from firstfix.errors import RateLimited
from firstfix_service.limits.limits import Limits
from firstfix_service.limits.rate import Rate


class Clock:
    def __init__(self) -> None:
        self.now = 1000.0

    def __call__(self) -> float:
        return self.now


def test_a_burst_then_a_steady_rate():
    clock = Clock()
    rate = Rate("queries", per_s=2.0, burst=3.0, clock=clock)
    for _ in range(3):
        rate.take("a")
    with pytest.raises(RateLimited) as refused:
        rate.take("a")
    assert refused.value.retry_after_s == pytest.approx(0.5)
    clock.now += 0.5
    rate.take("a")
    with pytest.raises(RateLimited):
        rate.take("a")


def test_being_refused_costs_nothing():
    clock = Clock()
    rate = Rate("queries", per_s=1.0, burst=1.0, clock=clock)
    rate.take("a")
    for _ in range(10):
        clock.now += 0.05
        with pytest.raises(RateLimited):
            rate.take("a")
    clock.now += 0.51
    rate.take("a")


def test_callers_do_not_share_a_bucket():
    rate = Rate("queries", per_s=1e-6, burst=1.0, clock=Clock())
    rate.take("a")
    rate.take("b")
    with pytest.raises(RateLimited):
        rate.take("a")


def test_a_rate_below_one_still_lets_one_through():
    rate = Rate("builds", per_s=0.001, burst=0.1, clock=Clock())
    rate.take("a")


def test_callers_beyond_number_take_no_memory(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(Limits, "max_names", 100)
    rate = Rate("queries", per_s=1e-6, burst=1.0, clock=Clock())
    rate.take("first")
    for n in range(1000):
        rate.take(f"c{n}")
    assert len(rate) == 100
    with pytest.raises(RateLimited):
        rate.take("c999")
    rate.take("first")


def test_what_is_owed_is_paid_at_the_rate_and_no_debt_grows_without_end():
    clock = Clock()
    rate = Rate("requests", per_s=2.0, burst=3.0, max_wait_s=1.5, clock=clock)
    assert [rate.take("a") for _ in range(7)] == [0.0, 0.0, 0.0, 0.5, 1.0, 1.5, 1.5]
    assert rate.take("b") == 0.0
    clock.now += 1.5
    assert rate.take("a") == 0.5
    clock.now += 100.0
    waits = [rate.take("a") for _ in range(4)]
    assert waits == [0.0, 0.0, 0.0, 0.5], "no more than the burst is saved"


def test_what_is_given_back_shortens_the_waits_of_others_and_is_never_more_than_the_burst():
    rate = Rate("requests", per_s=2.0, burst=2.0, max_wait_s=5.0, clock=Clock())
    assert [rate.take("a") for _ in range(4)] == [0.0, 0.0, 0.5, 1.0]
    rate.give_back("a")
    assert rate.take("a") == 1.0
    for _ in range(9):
        rate.give_back("a")
    assert [rate.take("a") for _ in range(3)] == [0.0, 0.0, 0.5]
