"""Times of calls: deadlines, waits before another attempt, and before a second replica is asked."""

from __future__ import annotations

import random

import pytest

from firstfix.errors import DeadlineExceeded
from firstfix_client import RetryPolicy
from firstfix_client.policies import HedgePolicy
from firstfix_client.steps.http_sender import retry_after_s
from firstfix_client.steps.send import ENOUGH, Deadline, Hedging
from tests.waiting import let_pass


def test_a_set_hedging_time_is_taken():
    hedging = Hedging(HedgePolicy(after_s=0.3))
    for _ in range(100):
        hedging.saw(0.001)
    assert hedging.after_s() == 0.3


def test_hedging_learns_what_answers_take():
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


@pytest.mark.parametrize(
    ("header", "seconds"),
    [("2", 2.0), ("0", 0.0), (None, None), ("", None), ("-1", None), ("nan", None), ("inf", None)]
    + [("Wed, 21 Oct 2026 07:28:00 GMT", None)],
)
def test_retry_after_is_read_in_seconds(header, seconds):
    assert retry_after_s(header) == seconds


def test_a_deadline_passes():
    long, short = Deadline(1000), Deadline(0.05)
    assert 0 < long.remaining_s() <= 1000
    assert long.allows(1)
    assert not long.allows(1001)
    let_pass(0.06)
    with pytest.raises(DeadlineExceeded):
        short.remaining_s()


def test_waits_grow_to_their_limit_and_differ():
    random.seed(1)
    policy = RetryPolicy(first_wait_s=0.1, max_wait_s=2.0)
    longest = [max(policy.wait_s(attempt) for _ in range(500)) for attempt in range(1, 9)]
    for attempt, seen in enumerate(longest, start=1):
        limit = min(2.0, 0.1 * 2 ** (attempt - 1))
        assert 0.9 * limit < seen <= limit
    assert len({policy.wait_s(3) for _ in range(20)}) == 20


def test_the_service_is_not_asked_earlier_than_it_said():
    waits = [RetryPolicy().wait_s(1, 3.0) for _ in range(200)]
    assert 3.0 <= min(waits) < max(waits) <= 3.75
