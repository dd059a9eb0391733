import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from firstfix.errors import BuildFailed
from firstfix_builder.mesh.level import level_frame

RNG = np.random.default_rng(7)
FLOOR = np.column_stack([RNG.uniform(0, 20, (9000, 2)), np.zeros(9000)])
WALLS = np.concatenate(
    [
        np.column_stack([RNG.uniform(0, 20, 4000), np.repeat([0.0, 20.0], 2000), RNG.uniform(0, 3, 4000)]),
        np.column_stack([np.repeat([0.0, 20.0], 2000), RNG.uniform(0, 20, 4000), RNG.uniform(0, 3, 4000)]),
    ]
)
ROOM = np.concatenate([FLOOR, WALLS])


def test_a_leaning_map_is_levelled():
    R_map_level = Rotation.from_euler("XY", [3.0, -2.0], degrees=True).as_matrix()
    T_map_level = level_frame(ROOM @ R_map_level.T)
    off_deg = np.degrees(np.arccos(T_map_level[:3, 2] @ R_map_level[:, 2]))
    assert off_deg < 0.1
    assert np.array_equal(T_map_level[:3, 3], np.zeros(3))


def test_an_upright_map_stays_as_it_is():
    assert np.array_equal(level_frame(ROOM), np.eye(4))


def test_points_that_are_not_finite_do_not_count():
    nowhere = np.float64([[np.nan, 0, 0], [0, np.inf, 0], [0, 0, -np.inf]])
    R_map_level = Rotation.from_euler("X", 3.0, degrees=True).as_matrix()
    leaning = ROOM @ R_map_level.T
    assert np.array_equal(level_frame(np.concatenate([leaning, nowhere])), level_frame(leaning))


def test_a_map_without_end_is_refused():
    with pytest.raises(BuildFailed, match="too large"):
        level_frame(np.concatenate([ROOM, [[1e18, 0, 0]]]))


@pytest.mark.parametrize("seed", range(4))
def test_a_change_of_a_part_does_not_turn_the_map(seed: int):
    """Else nothing of the version before could be used again."""
    R_map_level = Rotation.from_euler("XY", [2.1, -1.3], degrees=True).as_matrix()
    rng = np.random.default_rng(seed)
    rough = np.concatenate([ROOM] * 3) + rng.normal(0, 0.04, (3 * len(ROOM), 3))
    low = rng.uniform(2, 16, 2)
    inside = ((rough[:, :2] > low) & (rough[:, :2] < low + 2.0)).all(axis=1)
    things = np.column_stack([rng.uniform(low, low + 2.0, (400, 2)), rng.uniform(0, 1.5, 400)])
    before, after = (
        level_frame(part @ R_map_level.T) for part in (rough, np.concatenate([rough[~inside], things]))
    )
    assert np.array_equal(before, after)
