"""What many maps teach: the ceiling of a promise, and that each map is judged by the others."""

from __future__ import annotations

import pytest

from firstfix.builds.config import SelfTestConfig
from firstfix.scan.compact import CompactScan
from firstfix_builder.self_test.strangers import strangers
from firstfix_builder.self_test.taught_outcomes import (
    ALIKE,
    ELSEWHERE,
    HERE,
    MIN_CEILING,
    TaughtOutcome,
    TaughtOutcomes,
    taught_outcomes,
)
from firstfix_builder.self_test.threshold import Judged

PROMISE = SelfTestConfig().max_false_accept


def taught(*rows: tuple[str, str, float, bool, int]) -> TaughtOutcomes:
    """Rows by place, kind, claimed probability, whether right, and number."""
    found = [
        TaughtOutcome(place, place, "rings", 0.995, kind, Judged(claimed, right, kind == HERE))
        for place, kind, claimed, right, number in rows
        for _ in range(number)
    ]
    return TaughtOutcomes(tuple(found), "0")


def threshold(table: TaughtOutcomes, promise: float = PROMISE, but_of: str | None = None) -> float | None:
    found = table.ceiling(promise, but_of=but_of)
    return None if found is None else found.min_probability


RIGHT = ("hall", HERE, 0.9999, True, 3000)
STRANGE = ("hall", ELSEWHERE, 0.3, False, 3000)


def test_the_ceiling_is_the_lowest_threshold_at_which_many_maps_keep_the_promise():
    assert threshold(taught(RIGHT, STRANGE)) == MIN_CEILING
    assert threshold(taught(RIGHT, STRANGE, ("mill", HERE, 0.992, False, 30))) == 0.995
    assert threshold(taught(RIGHT, STRANGE, ("mill", ELSEWHERE, 0.992, False, 200))) == 0.995


def test_few_wrong_answers_among_many_right_ones_break_no_promise():
    few = ("mill", HERE, 0.9996, False, 3)
    assert threshold(taught(RIGHT, STRANGE, few)) == MIN_CEILING
    assert threshold(taught(RIGHT, STRANGE, few), promise=0.0005) is None


def test_of_few_answers_nothing_is_learned():
    assert threshold(taught()) is None
    assert threshold(taught(("hall", HERE, 0.9999, True, 50), ("hall", ELSEWHERE, 0.1, False, 50))) is None


def test_look_alikes_teach_no_ceiling():
    assert threshold(taught(RIGHT, STRANGE, ("mill", ALIKE, 0.9999, False, 300))) == MIN_CEILING


def test_a_place_can_be_held_out():
    table = taught(RIGHT, STRANGE, ("mill", HERE, 0.992, False, 60))
    assert (threshold(table), threshold(table, but_of="mill")) == (0.995, MIN_CEILING)


def test_the_table_of_the_release_is_of_many_maps_and_sensors():
    table = taught_outcomes()
    maps = {row.map for row in table.rows}
    assert len(maps) >= 20
    assert len({row.sensor for row in table.rows}) >= 5
    assert table.to_mapping() == {"version": table.version, "maps": len(maps), "answers": len(table.rows)}


def test_each_map_of_the_release_keeps_the_promise_by_what_the_others_teach():
    """Leave one map out: a map's own threshold, at most the ceiling that all other places teach."""
    table, localized, wrong, strange = taught_outcomes(), 0, 0, 0
    for place in {row.place for row in table.rows}:
        ceiling = table.ceiling(PROMISE, but_of=place)
        assert ceiling is not None
        for row in table.rows:
            if row.place != place or row.kind == ALIKE:
                continue
            if row.case.claimed >= min(row.own_threshold, ceiling.min_probability):
                localized += 1
                wrong += row.kind == HERE and not row.case.right
                strange += row.kind == ELSEWHERE
    assert localized > 1000
    assert wrong + strange <= PROMISE * localized
    assert strange <= 2


def test_the_strangers_are_whole_scans_of_several_sensors():
    scans = strangers()
    assert len(scans) == 2 * SelfTestConfig().outside
    assert all(isinstance(scan, CompactScan) and len(scan) >= 300 for scan in scans)
    assert len({len(scan) for scan in scans}) > 10


@pytest.mark.parametrize("share", [0.01, 0.005])
def test_who_allows_more_is_given_no_higher_ceiling_by_the_release(share: float):
    found, lax = taught_outcomes().ceiling(share), taught_outcomes().ceiling(2 * share)
    assert found is not None
    assert lax is not None
    assert lax.min_probability <= found.min_probability
    assert found.bound <= share
