from __future__ import annotations

from dataclasses import dataclass

from firstfix_service.maps.eviction_order import EvictionOrder
from firstfix_service.maps.version_files import Key


@dataclass
class Item:
    bytes: int


def order_of(protected: set[str], *names: str) -> EvictionOrder:
    order: EvictionOrder = EvictionOrder(lambda key: key[0] in protected)
    for size, name in enumerate(names, 1):
        order.add(key(name), Item(size))
    return order


def key(name: str) -> Key:
    return name, "v"


def names(order: EvictionOrder) -> str:
    return "".join(name for name, _ in order)


def test_the_least_recently_used_is_evicted_first():
    order = order_of(set(), *"abc")
    assert order.use(key("a")) == Item(1)
    assert names(order) == "bca"
    assert order.use(key("d")) is None
    assert len(order) == 3


def test_what_is_kept_leaves_after_the_others_however_long_ago_it_was_used():
    order = order_of(set("ac"), *"abcd")
    assert names(order) == "bdac"
    order.use(key("a"))
    order.use(key("b"))
    assert names(order) == "dbca"
    assert (order.protected, order.protected_bytes, order.bytes) == (2, 4, 10)


def test_bytes_are_those_of_the_versions_present():
    order = order_of(set("ac"), *"abcd")
    assert order.pop(key("c")) == Item(3)
    assert order.pop(key("b")) == Item(2)
    assert (order.protected, order.protected_bytes, order.bytes) == (1, 1, 5)
    assert key("b") not in order
    assert key("a") in order


def test_another_choice_of_what_is_kept_counts_when_it_is_sorted_again():
    protected = set("ac")
    order = order_of(protected, *"abcd")
    protected ^= set("ab")
    order.reclassify()
    assert names(order) == "dacb"
    assert (order.protected, order.protected_bytes, order.bytes) == (2, 5, 10)
