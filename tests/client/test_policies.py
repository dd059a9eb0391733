"""Waits grow, are random, and are never shorter than the service asked for."""

from __future__ import annotations

import random

from firstfix_client import RetryPolicy


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
