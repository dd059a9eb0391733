"""Scans of a part of the turn: localized beside the whole one, and never taken for one in a wrong frame.

``firstfix-lab half_turns`` asks more of them, in more places.
"""

from __future__ import annotations

import random
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from firstfix.answer.localization import Localization, Verdict
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer
from firstfix.scan.scan import Scan
from firstfix_lab.drills.half_turns import (
    FULL_DEG,
    HALL_AT_90,
    Told,
    ask,
    is_named,
    scans_of,
    window,
    wrong_frames,
)
from tests.recorded_data import HALL

pytestmark = pytest.mark.slow

SEED = 2  # of the scans that are asked


def some(scans: list, count: int) -> list:
    """Scans drawn by chance."""
    return random.Random(SEED).sample(scans, count)


def assert_none_is_taken_for_another_frame(told: dict[int, list[Told]]) -> None:
    for width_deg, of_width in told.items():
        assert not any(one.turned_away for one in of_width), width_deg
        assert not any(one.named and one.is_right_first for one in of_width), width_deg


def test_parts_of_a_simulated_scan_are_localized(small_version, small_scans):
    localizer = Localizer(MapIndex.load(small_version.directory))
    told = ask(localizer, [(scan.points, T) for scan, T in some(small_scans, 4)])
    assert_none_is_taken_for_another_frame(told)
    whole, half = (np.mean([one.is_right for one in told[width_deg]]) for width_deg in (FULL_DEG, 180))
    assert whole > 0
    assert half > whole / 2


def test_parts_of_a_real_scan_are_localized(hall_directory: Path):
    scans = some(scans_of(HALL), 3)
    localizer = Localizer(MapIndex.load(hall_directory))
    told = ask(localizer, scans)
    assert_none_is_taken_for_another_frame(told)
    assert np.mean([one.is_right for one in told[90]]) >= HALL_AT_90
    for points, T_map_sensor in scans:
        for frame, moved in wrong_frames(points, T_map_sensor):
            assert_named(localizer.localize(Scan.from_points(moved)), frame)


def test_moved_scans_are_named(small_version, small_scans):
    localizer = Localizer(MapIndex.load(small_version.directory))
    named: Counter[bool] = Counter()
    for scan, T_map_sensor in some(small_scans, 7):
        for frame, moved in wrong_frames(scan.points, T_map_sensor):
            assert_named(localizer.localize(Scan.from_points(moved)), frame)
        for _, moved in wrong_frames(window(scan.points, 180, 0), T_map_sensor):
            named[is_named(localizer.localize(Scan.from_points(moved)))] += 1
    assert named[True] > named[False]


def assert_named(answer: Localization, frame: str) -> None:
    assert answer.verdict is not Verdict.LOCALIZED, frame
    assert is_named(answer), frame
