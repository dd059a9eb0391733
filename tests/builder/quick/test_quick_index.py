"""The places of a provisional version's templates."""

from __future__ import annotations

import numpy as np
import pytest

from firstfix.errors import BuildFailed
from firstfix_builder.quick.quick_index import MAX_PLACES, QuickPlaces


def along_x(*x_m: float) -> np.ndarray:
    return np.column_stack([x_m, np.full(len(x_m), 0.2), np.full(len(x_m), 1.1)])


def test_a_run_that_stands_still_and_comes_back_has_one_place_a_spot():
    out = [0.1 * k for k in range(100)]
    places = QuickPlaces.along(along_x(*[0.0] * 500, *out, *reversed(out)), 1.0)
    assert places.at[:, 0].tolist() == pytest.approx(range(10))
    assert places.spacing_m == 1.0


def test_poses_further_apart_than_asked_are_all_places_and_tell_the_spacing():
    places = QuickPlaces.along(along_x(0.0, 2.1, 4.2, 6.4), 1.0)
    assert len(places.at) == 4
    assert places.spacing_m == 2.1


def test_a_single_pose_is_one_place():
    assert QuickPlaces.along(along_x(3.0), 0.5).spacing_m == 0.5


def test_a_run_that_would_take_minutes_has_no_first_version():
    with pytest.raises(BuildFailed, match="longer than"):
        QuickPlaces.along(along_x(*range(MAX_PLACES + 1)), 1.0)
