"""Places right above and below a pose, in maps of one storey and of several."""

from __future__ import annotations

import numpy as np
import pytest

from firstfix import native
from firstfix.engine.candidates import Candidates
from firstfix.engine.retrieval.template_tiles import TemplateTiles
from firstfix.native import is_stacked
from firstfix.transform import make_transform, rotation_z

MOUNT_M = 0.8
HERE = make_transform(rotation_z(0.4), [3.2, 1.1, 1.0])  # mounted higher than the templates
GRID = np.stack(np.meshgrid(np.arange(8.0), np.arange(4.0)), axis=-1).reshape(-1, 2)


def places_of(floors_m: list[float], *, only: np.ndarray | None = None) -> native.TemplatePlaces:
    """Places of templates on a grid on each floor; ``only`` is the grid of all but the first."""
    grids = [GRID, *([GRID if only is None else only] * (len(floors_m) - 1))]
    position_m = np.concatenate(
        [
            np.column_stack([grid, np.full(len(grid), floor_m + MOUNT_M)])
            for grid, floor_m in zip(grids, floors_m, strict=True)
        ]
    ).astype(np.float32)
    tiles, height_m = TemplateTiles.of(position_m), np.full(len(position_m), MOUNT_M, np.float32)
    return native.TemplatePlaces(position_m, height_m, tiles.row, tiles.begin, tiles.low)


def stacked_places(places: native.TemplatePlaces, T_level_sensor: np.ndarray) -> Candidates:
    return Candidates(*places.stacked(T_level_sensor))


def test_the_pose_keeps_all_but_its_height():
    found = stacked_places(places_of([0.0, 3.4]), HERE)
    assert len(found) == 1
    expected = make_transform(np.eye(3), [0, 0, 3.4]) @ HERE
    np.testing.assert_allclose(found.T_level_sensor[0], expected, atol=1e-6)
    assert GRID[found.template[0] - len(GRID)] == pytest.approx([3, 1])


def test_one_storey_has_none():
    assert not len(stacked_places(places_of([0.0]), HERE))


def test_a_step_in_the_floor_is_no_storey():
    assert not len(stacked_places(places_of([0.0, 0.4]), HERE))


def test_a_storey_without_templates_near_by_has_none():
    away = GRID + [20, 0]
    assert not len(stacked_places(places_of([0.0, 3.4], only=away), HERE))


def test_where_the_map_has_no_templates_there_are_none():
    outside = make_transform(np.eye(3), [300, 0, 1.0])
    assert not len(stacked_places(places_of([0.0, 3.4]), outside))


def test_of_a_tower_the_nearest_floors_are_taken():
    floors_m = [0.0, *(-3.0 * n for n in range(1, 4)), *(3.0 * n for n in range(1, 9))]
    found = stacked_places(places_of(floors_m), HERE)
    by_m = found.T_level_sensor[:, 2, 3] - HERE[2, 3]
    assert np.sort(by_m).tolist() == pytest.approx([-6, -3, 3, 6], abs=1e-5)


def test_what_is_above_is_not_beside():
    at_m = np.array([0.0, 0, 1])
    others_m = np.array([[0.5, 0, 4.4], [0.5, 0, 1.4], [5.0, 0, 4.4], [0, 0, -2.4]])
    assert is_stacked(at_m, others_m).tolist() == [True, False, False, True]
