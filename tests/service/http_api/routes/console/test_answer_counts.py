"""GET /answers/counts: what was answered lately, by map."""

from __future__ import annotations

import pytest

from firstfix_service.localize import answer_counts
from firstfix_service.localize.answer_counts import DAY_S, HOUR_S, AnswerCounts, Counted

NOW_S = 1_800_000_000.0


def test_answers_are_counted_for_an_hour_and_a_day():
    counts = AnswerCounts()
    counts.add("hall", True, NOW_S - DAY_S - 600)
    counts.add("hall", False, NOW_S - 2 * HOUR_S)
    counts.add("hall", True, NOW_S - 60)
    counts.add("yard", False, NOW_S)
    hall, yard = counts.of_maps(NOW_S)
    assert (hall.map_id, hall.hour, hall.day) == ("hall", Counted(1, 1), Counted(2, 1))
    assert (yard.map_id, yard.hour, yard.last_time_s) == ("yard", Counted(1, 0), NOW_S)
    (hall, _) = counts.of_maps(NOW_S + HOUR_S + 600)
    assert (hall.hour, hall.day) == (Counted(), Counted(2, 1))


def test_the_counts_of_many_maps_take_bounded_memory(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(answer_counts, "MOST_MAPS", 3)
    counts = AnswerCounts()
    for number in range(5):
        counts.add(f"map-{number}", True, NOW_S + number)
    assert [one.map_id for one in counts.of_maps(NOW_S)] == ["map-2", "map-3", "map-4"]
    for step in range(1000):
        counts.add("map-4", True, NOW_S + step * answer_counts.STEP_S)
    assert len(counts._maps["map-4"].counts) <= DAY_S / answer_counts.STEP_S + 1
