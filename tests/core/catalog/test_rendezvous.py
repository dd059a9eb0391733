"""Order of replicas for a map: the same everywhere, balanced, and with few moves when a replica leaves."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest

from firstfix.catalog.rendezvous import rank, rendezvous_order, weight

MAPS = [f"map-{k:05}" for k in range(6000)]
REPLICAS = ["r1", "r2", "r3", "r4"]


def test_the_weight_is_the_documented_one():
    # printf hall/r1 | sha256sum | cut -c1-16
    expected = {"r1": "000e0fa97676670a", "r2": "879bb0ea0585f423", "r3": "82ff704164163efa"}
    page = (Path(__file__).resolve().parents[3] / "lab" / "docs" / "many-maps.md").read_text()
    for name, digits in expected.items():
        assert f"{weight('hall', name):016x}" == digits
        assert f"    {digits}\n" in page
    assert rendezvous_order("hall", expected) == ["r2", "r3", "r1"]


def test_the_order_is_that_of_the_weights_however_the_names_are_given():
    expected = sorted(REPLICAS, key=lambda name: -weight("hall", name))
    assert rendezvous_order("hall", REPLICAS) == expected
    assert rendezvous_order("hall", [*reversed(REPLICAS), "r2"]) == expected
    assert rendezvous_order("hall", []) == []


def test_a_rank_is_the_place_in_the_order():
    for map_id in MAPS[:200]:
        order = rendezvous_order(map_id, REPLICAS)
        assert [rank(map_id, name, REPLICAS) for name in order] == [0, 1, 2, 3]
    assert rank("hall", "r1", []) == 0
    assert rank("hall", "r9", REPLICAS) == rendezvous_order("hall", [*REPLICAS, "r9"]).index("r9")


@pytest.mark.parametrize("copies", [1, 2, 3])
def test_maps_are_spread_evenly(copies: int):
    held = Counter(name for map_id in MAPS for name in rendezvous_order(map_id, REPLICAS)[:copies])
    even = len(MAPS) * copies / len(REPLICAS)
    for name in REPLICAS:
        assert abs(held[name] - even) < 0.06 * even


@pytest.mark.parametrize("copies", [1, 2])
def test_only_maps_of_a_leaving_replica_move(copies: int):
    moved = 0
    for map_id in MAPS:
        before = rendezvous_order(map_id, REPLICAS)[:copies]
        after = rendezvous_order(map_id, [name for name in REPLICAS if name != "r3"])[:copies]
        if "r3" in before:
            moved += 1
            assert set(before) - {"r3"} < set(after)
            assert [name for name in after if name in before] == [name for name in before if name != "r3"]
        else:
            assert after == before
    share = copies / len(REPLICAS)
    assert abs(moved / len(MAPS) - share) < 0.03, "and it held its share"


def test_a_new_replica_takes_its_share_from_all():
    taken: Counter[str] = Counter()
    for map_id in MAPS:
        before = rendezvous_order(map_id, REPLICAS)[0]
        after = rendezvous_order(map_id, [*REPLICAS, "r5"])[0]
        if after != before:
            assert after == "r5"
            taken[before] += 1
    assert abs(sum(taken.values()) / len(MAPS) - 1 / 5) < 0.03
    assert min(taken.values()) > 0.8 * max(taken.values())
