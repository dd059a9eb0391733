import numpy as np

from firstfix.engine.verification.point_tiles import PointTiles

POINTS = np.random.default_rng(2).uniform([-31, 12, -2], [44, 61, 5], (4000, 3))
TILES = PointTiles.of(POINTS, 0.01)  # so finely that every point stays


def brute(centre: np.ndarray, reach_m: float) -> np.ndarray:
    away = POINTS - centre
    return away[np.linalg.norm(away, axis=1) < reach_m]


def in_order(points: np.ndarray) -> np.ndarray:
    return points[np.lexsort(points.T)]


def test_around_a_place_every_point_within_reach_is_found():
    for centre in ([0, 30, 0], [-31, 12, 0], [43.9, 60.9, 4], [-40, 5, 0], [20, 37.5, 1]):
        found, wanted = TILES.around(np.array(centre, float), 11.0), brute(np.array(centre), 11.0)
        assert len(found) == len(wanted)
        assert np.allclose(in_order(found.round(3)), in_order(wanted.round(3)), atol=2e-3)


def test_far_outside_nothing_is_found():
    for centre in ([500, 0, 0], [0, -900, 0], [-500, 900, 0]):
        assert len(TILES.around(np.array(centre, float), 20.0)) == 0


def test_what_was_saved_is_the_same(tmp_path):
    TILES.save(tmp_path / "tiles")
    again, centre = PointTiles.load(tmp_path / "tiles"), np.array([3.0, 33.0, 0.5])
    assert np.array_equal(again.around(centre, 15.0), TILES.around(centre, 15.0))
