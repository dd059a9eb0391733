from __future__ import annotations

import pytest

from firstfix.errors import RateLimited
from firstfix_service.auth import rate_limit
from firstfix_service.auth.rate_limit import RateLimit


class Clock:
    def __init__(self) -> None:
        self.now = 1000.0

    def __call__(self) -> float:
        return self.now


def test_a_burst_then_a_steady_rate():
    clock = Clock()
    limit = RateLimit("queries", per_s=2.0, burst=3.0, clock=clock)
    for _ in range(3):
        limit.take("a")
    with pytest.raises(RateLimited) as refused:
        limit.take("a")
    assert refused.value.retry_after_s == pytest.approx(0.5)
    clock.now += 0.5
    limit.take("a")
    with pytest.raises(RateLimited):
        limit.take("a")


def test_being_refused_costs_nothing():
    clock = Clock()
    limit = RateLimit("queries", per_s=1.0, burst=1.0, clock=clock)
    limit.take("a")
    for _ in range(10):
        clock.now += 0.05
        with pytest.raises(RateLimited):
            limit.take("a")
    clock.now += 0.51
    limit.take("a")


def test_callers_do_not_share_a_bucket():
    limit = RateLimit("queries", per_s=1e-6, burst=1.0, clock=Clock())
    limit.take("a")
    limit.take("b")
    with pytest.raises(RateLimited):
        limit.take("a")


def test_a_rate_below_one_still_lets_one_through():
    limit = RateLimit("builds", per_s=0.001, burst=0.1, clock=Clock())
    limit.take("a")


def test_callers_beyond_number_take_no_memory(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(rate_limit, "MAX_CALLERS", 100)
    limit = RateLimit("queries", per_s=1e-6, burst=1.0, clock=Clock())
    limit.take("first")
    for n in range(1000):
        limit.take(f"c{n}")
    assert len(limit) == 100
    with pytest.raises(RateLimited):
        limit.take("c999")
    limit.take("first")


def test_what_is_owed_is_paid_at_the_rate_and_no_debt_grows_without_end():
    clock = Clock()
    limit = RateLimit("requests", per_s=2.0, burst=3.0, clock=clock)
    assert [limit.take_on_credit("a", 1.5) for _ in range(7)] == [0.0, 0.0, 0.0, 0.5, 1.0, 1.5, 1.5]
    assert limit.take_on_credit("b", 1.5) == 0.0
    clock.now += 1.5
    assert limit.take_on_credit("a", 1.5) == 0.5
    clock.now += 100.0
    waits = [limit.take_on_credit("a", 1.5) for _ in range(4)]
    assert waits == [0.0, 0.0, 0.0, 0.5], "no more than the burst is saved"


def test_what_is_given_back_shortens_the_waits_of_others_and_is_never_more_than_the_burst():
    limit = RateLimit("requests", per_s=2.0, burst=2.0, clock=Clock())
    assert [limit.take_on_credit("a", 5.0) for _ in range(4)] == [0.0, 0.0, 0.5, 1.0]
    limit.give_back("a")
    assert limit.take_on_credit("a", 5.0) == 1.0
    for _ in range(9):
        limit.give_back("a")
    assert [limit.take_on_credit("a", 5.0) for _ in range(3)] == [0.0, 0.0, 0.5]
