"""Parts of a drive that are held out: by chance, apart from each other, only where others saw the same."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from firstfix_builder.sources.read_map.held_out_parts import (
    ALONE,
    FAR,
    MIN_KEYFRAMES,
    NEAR_M,
    PARTS,
    OtherKeyframes,
    drawn_parts,
)


def way(count: int, step_m: float = 2.0) -> np.ndarray:
    return np.column_stack([step_m * np.arange(count), np.zeros((count, 2))])


@pytest.mark.parametrize(
    ("count", "most", "keyframes", "parts"),
    [
        (1000, 40, 40, PARTS),
        (1000, 200, 100, PARTS),  # a tenth
        (213, 40, 21, 11),
        (MIN_KEYFRAMES, 40, 2, 1),
        (MIN_KEYFRAMES - 1, 40, 0, 0),
        (1000, 1, 1, 1),
        (1000, 0, 0, 0),
        (0, 40, 0, 0),
    ],
)
def test_some_20_parts_of_few_keyframes(count: int, most: int, keyframes: int, parts: int):
    found = drawn_parts(way(count), most)
    assert len(found) == parts
    assert sum(map(len, found)) == keyframes
    assert all(0 <= part.start < part.stop <= count for part in found)
    assert all(before.stop < after.start for before, after in pairwise(found)), "a keyframe stays between"


def test_the_same_seed_draws_the_same_parts_and_they_have_no_stride():
    found = drawn_parts(way(400), 40, seed=3)
    assert found == drawn_parts(way(400), 40, seed=3)
    assert found != drawn_parts(way(400), 40, seed=4)
    assert len({after.start - before.start for before, after in pairwise(found)}) > 5


def test_a_stop_of_the_robot_counts_as_one_place():
    still = np.concatenate([way(100), np.repeat(way(100)[-1:], 400, axis=0), way(200)[100:]])
    found = drawn_parts(still, 40)
    assert len(found) == PARTS
    assert sum(100 <= part.start < 500 for part in found) <= 2


def test_of_a_robot_that_never_moved_one_part_is_drawn_at_most():
    assert len(drawn_parts(np.zeros((100, 3)), 40)) <= 1


def test_only_what_others_saw_is_held_out():
    rng = np.random.default_rng(1)
    wall = rng.uniform([0, 3, 0], [10, 3, 3], (4000, 3))
    others = OtherKeyframes(wall, way(5))
    here = np.array([4.0, 0, 0])
    again = wall[:1000] + [0, 0.05, 0]
    assert others.why_kept(again, here) is None
    room = rng.uniform([20, 3, 0], [22, 3, 3], (50, 3))
    assert others.why_kept(np.concatenate([again, room]), here) is None, "less than a tenth is new"
    assert others.why_kept(np.concatenate([again, room, room, room]), here) == ALONE
    assert others.why_kept(np.empty((0, 3)), here) == ALONE
    assert others.why_kept(again, np.array([8.0 + NEAR_M + 0.1, 0, 0])) == FAR
    nothing = OtherKeyframes(np.empty((0, 3)), np.empty((0, 3)))
    assert nothing.why_kept(again, here) == FAR
