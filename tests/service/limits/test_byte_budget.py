from __future__ import annotations

import pytest

from firstfix.errors import Overloaded, QuotaExceeded
from firstfix_service.limits.byte_budget import ByteBudget, Lease, Owner, owners_of_body
from firstfix_service.limits.limits import Limits


def body(budget: ByteBudget, caller: str, size: int) -> Lease:
    lease = budget.lease(*owners_of_body(caller))
    lease.grow(size)
    return lease


def test_one_caller_leaves_half_to_the_others():
    budget = ByteBudget.of_bodies(100)
    for _ in range(5):
        body(budget, "a", 10)
    with pytest.raises(Overloaded, match="of this caller"):
        body(budget, "a", 10)
    for _ in range(5):
        body(budget, "b", 10)
    with pytest.raises(Overloaded, match="too many bodies arrive"):
        body(budget, "c", 10)
    assert budget.bytes == 100


def test_one_body_alone_may_have_all_and_no_more():
    budget = ByteBudget.of_bodies(100)
    lease = body(budget, "a", 60)
    lease.grow(40)
    with pytest.raises(Overloaded):
        lease.grow(1)
    assert lease.size == budget.bytes == 100
    lease.end()
    lease.end()
    assert budget.bytes == 0
    assert not budget._taken, "who has none is forgotten"


def test_pieces_count_as_they_come():
    budget = ByteBudget.of_bodies(100)
    body(budget, "a", 30)
    second = body(budget, "a", 10)
    with pytest.raises(Overloaded):
        second.grow(11)
    second.grow(10)


def test_a_body_counts_for_all_until_its_caller_is_known():
    budget = ByteBudget.of_bodies(100)
    first, second = body(budget, "", 30), body(budget, "", 30)
    with pytest.raises(Overloaded, match="too many bodies arrive"):
        body(budget, "a", 41)
    first.name(*owners_of_body("a"))
    with pytest.raises(Overloaded, match="of this caller"):
        second.name(*owners_of_body("a"))
    assert (budget.bytes, second.owners) == (60, ()), "it counts for nobody"
    budget.give_back((), 30)
    first.end()
    assert budget.bytes == 0
    assert not budget._taken


def test_an_answer_alone_may_be_larger_than_its_part_and_than_all(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(Limits, "small_answer_bytes", 10)
    budget = ByteBudget.of_answers(80)

    def answer(caller: str, address: str, size: int) -> Lease:
        lease = budget.lease(Owner("caller", caller, 4), Owner("address", address, 2))
        lease.grow(size)
        return lease

    large = answer("a", "1", 100)
    with pytest.raises(QuotaExceeded, match="this caller"):
        answer("a", "1", 1)
    with pytest.raises(QuotaExceeded, match="this address"):
        answer("b", "1", 1)
    with pytest.raises(Overloaded):
        answer("b", "2", 1)
    large.end()
    answer("a", "1", 20)
    answer("b", "1", 20)
    answer("c", "2", 25)
    with pytest.raises(Overloaded):
        answer("d", "3", 10)
    answer("d", "3", 9).end()
    with pytest.raises(QuotaExceeded, match="this address"):
        answer("d", "1", 9)
