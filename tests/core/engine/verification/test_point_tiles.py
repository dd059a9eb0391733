import pickle

import numpy as np
import pytest

from firstfix.engine.verification.point_tiles import PointTiles
from firstfix.scan.reduction import nearest_by_direction
from firstfix.transform import make_transform
from tests.reference.free_space import around

POINTS = np.random.default_rng(2).uniform([-31, 12, -2], [44, 61, 5], (4000, 3))
TILES = PointTiles.of(POINTS, 0.01)  # so finely that every point stays
CENTRES = ([0, 30, 0], [-31, 12, 0], [43.9, 60.9, 4], [-40, 5, 0], [20, 37.5, 1], [500, 0, 0], [-500, 900, 0])


def nearest_around(tiles: PointTiles, centre: list[float], reach_m: float) -> np.ndarray:
    return tiles.tables.nearest_by_direction(make_transform(np.eye(3), centre), reach_m)


def brute(centre: list[float], reach_m: float) -> np.ndarray:
    away = (TILES.points - np.float32(centre)).astype(np.float32)
    x, y, z = away.T
    return nearest_by_direction(away[x * x + y * y + z * z < np.float32(reach_m**2)])


def test_around_a_place_every_point_within_reach_is_found():
    for centre in CENTRES:
        for reach_m in (3.0, 11.0, 25.0):
            assert np.array_equal(nearest_around(TILES, centre, reach_m), brute(centre, reach_m))
    assert np.isfinite(nearest_around(TILES, [0, 30, 0], 11.0)).sum() > 100
    assert not np.isfinite(nearest_around(TILES, [500, 0, 0], 11.0)).any()


def test_the_tiles_are_those_that_numpy_reads():
    for centre in CENTRES:
        away = around(TILES, np.array(centre, float), 11.0)
        assert np.array_equal(nearest_around(TILES, centre, 11.0), nearest_by_direction(away))


def test_loaded_tiles_are_the_same(tmp_path):
    TILES.save(tmp_path / "tiles")
    for again in (PointTiles.load(tmp_path / "tiles"), pickle.loads(pickle.dumps(TILES))):
        for name in ("points", "begin", "low"):
            assert np.array_equal(getattr(again, name), getattr(TILES, name))
        assert np.array_equal(
            nearest_around(again, [3, 33, 0.5], 15.0), nearest_around(TILES, [3, 33, 0.5], 15.0)
        )


def test_a_damaged_table_finds_points_or_none():
    rng = np.random.default_rng(4)
    for _ in range(50):
        begin = rng.integers(-(2**31), 2**31, TILES.begin.shape, np.int64).astype(np.int32)
        low = rng.choice(np.int32([-(2**31), -7, 0, 3, 2**31 - 1]), 2)
        points = TILES.points.copy()
        points[rng.random(points.shape) < 0.1] = rng.choice(np.float32([np.nan, np.inf, -np.inf, 3e38]))
        nearest = nearest_around(PointTiles(points, begin, low), [0, 30, 0], 11.0)
        assert ((nearest > 0) & ((nearest < 11.001) | np.isinf(nearest))).all()


def test_an_invalid_pose_sees_nothing():
    for wrong in (np.nan, np.inf, -np.inf, 1e300):
        assert not np.isfinite(nearest_around(TILES, [wrong, 30, 0], 11.0)).any()
        T = make_transform(np.full((3, 3), wrong), [0, 30, 0])
        assert not np.isfinite(TILES.tables.nearest_by_direction(T, 11.0)).any()


def test_tables_of_another_shape_or_type_are_refused():
    for points, begin, low in (
        (TILES.points[:, :2], TILES.begin, TILES.low),
        (TILES.points.astype(np.float64), TILES.begin, TILES.low),
        (TILES.points, TILES.begin[0], TILES.low),
        (TILES.points, TILES.begin[:, :0], TILES.low),
        (TILES.points, TILES.begin, TILES.low[:1]),
    ):
        with pytest.raises((ValueError, TypeError)):
            PointTiles(points, begin, low)
