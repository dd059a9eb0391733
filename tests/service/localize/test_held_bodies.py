from __future__ import annotations

import pytest

from firstfix.errors import Overloaded
from firstfix_service.localize.held_bodies import HeldBodies


def test_one_caller_leaves_half_to_the_others():
    held = HeldBodies(100)
    for _ in range(5):
        held.add("a", 10, body_bytes=10)
    with pytest.raises(Overloaded, match="of this caller"):
        held.add("a", 10, body_bytes=10)
    for _ in range(5):
        held.add("b", 10, body_bytes=10)
    with pytest.raises(Overloaded, match="too many bodies arrive"):
        held.add("c", 10, body_bytes=10)
    assert held.bytes == 100


def test_one_body_alone_may_have_all():
    held = HeldBodies(100)
    held.add("a", 60, body_bytes=60)
    held.add("a", 40, body_bytes=100)
    with pytest.raises(Overloaded):
        held.add("a", 1, body_bytes=101)
    held.give_back("a", 100)
    assert held.bytes == 0
    assert not held._of_caller, "who has none is forgotten"


def test_pieces_count_as_they_come():
    held = HeldBodies(100)
    held.add("a", 30, body_bytes=30)
    held.add("a", 10, body_bytes=10)
    with pytest.raises(Overloaded):
        held.add("a", 11, body_bytes=21)


def test_a_body_counts_for_all_until_its_caller_is_known():
    held = HeldBodies(100)
    held.add("", 30, body_bytes=30)
    held.add("", 30, body_bytes=30)
    with pytest.raises(Overloaded, match="too many bodies arrive"):
        held.add("a", 41, body_bytes=41)
    held.name_caller("a", 30)
    with pytest.raises(Overloaded, match="of this caller"):
        held.name_caller("a", 30)
    held.give_back("", 30)
    held.give_back("a", 30)
    assert held.bytes == 0
    assert not held._of_caller
