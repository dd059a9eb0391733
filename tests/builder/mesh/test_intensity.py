"""The intensity of a map's points: its scale, and that it stays with its points."""

from __future__ import annotations

import numpy as np
import pytest

from firstfix_builder.mesh.intensity import Intensity, joined_intensity

RNG = np.random.default_rng(3)


def test_a_few_reflectors_do_not_make_all_else_dark():
    column = np.append(RNG.uniform(10, 60, 5000), np.full(20, 4e4)).astype(np.float32)
    found = Intensity.of(column)
    assert found is not None
    assert 9 < found.low < 13
    assert 55 < found.high < 61
    dark, bright = found.values[:5000][column[:5000] < 15], found.values[:5000][column[:5000] > 55]
    assert dark.max() < 40 < 210 < bright.min()
    assert (found.values[5000:] == 255).all()


@pytest.mark.parametrize("column", [None, [], [7] * 100, [np.nan] * 4, [np.inf, -np.inf]])
def test_where_all_is_the_same_there_is_none(column: list[float] | None):
    assert Intensity.of(None if column is None else np.array(column)) is None


def test_what_is_seldom_bright_is_shown_all_the_same():
    found = Intensity.of(np.append(np.zeros(999, np.uint16), np.uint16(40)))
    assert found is not None
    assert (found.low, found.high) == (0, 40)
    assert found.values[-1] == 255


def test_numbers_that_are_none_are_dark():
    found = Intensity.of(np.array([np.nan, np.inf, 1.0, 3e300, -np.inf, 2.0]))
    assert found is not None
    assert found.values[0] == 0
    assert found.values[1] == 255
    assert Intensity.of(np.array([-1.7e308, 1.7e308])) is None


def test_only_points_that_are_kept_count(tmp_path):
    column, kept = np.array([5, 1000, 6, 7, 9]), np.array([True, False, True, True, True])
    found = Intensity.of(column, kept)
    assert found is not None
    assert len(found.values) == 4
    assert found.high < 10
    found.save(tmp_path / "one.npz")
    again = Intensity.load(tmp_path / "one.npz")
    np.testing.assert_array_equal(again.values, found.values)
    assert (again.low, again.high) == (found.low, found.high)
    np.testing.assert_array_equal(found.at(np.array([3, 0])).values, found.values[[3, 0]])


def test_clouds_of_different_scales_are_joined_on_one():
    parts = [RNG.uniform(0, 100, 400), RNG.uniform(0, 4000, 400)]
    found = joined_intensity([Intensity.of(part) for part in parts])
    assert found is not None
    told = found.low + found.values * (found.high - found.low) / 255
    step = (found.high - found.low) / 255
    ends = np.percentile(parts[0], (2, 98)), np.percentile(parts[1], (2, 98))
    wanted = np.concatenate([np.clip(part, *end) for part, end in zip(parts, ends, strict=True)])
    assert np.abs(told - wanted).max() < 1.5 * step
    assert joined_intensity([Intensity.of(parts[0]), None]) is None
    assert joined_intensity([]) is None
