import numpy as np
import pytest

from firstfix.occupancy import LayeredGrid, best_shifts, occupancy, ring_spectrum
from firstfix.polar import PolarGrid

GRID = LayeredGrid(PolarGrid(10, 36, 20.0), (0.3, 1.0, 2.0, 8.0))


def filled(points, height_m=1.0):
    points = np.asarray(points, np.float32)
    return occupancy(points, np.zeros(len(points), np.intp), 1, np.array([height_m], np.float32), GRID)


@pytest.mark.parametrize(
    ("point", "cell"),
    [
        ([1, 0.01, 0], (10, 0)),  # 1.0 m above the floor: second layer, first ring, first sector
        ([5, 0.01, -0.5], (2, 0)),  # 0.5 m: first layer, third ring
        ([-5, -0.01, 3], (22, 18)),  # 4 m: third layer, half-way round
    ],
)
def test_a_point_fills_its_cell(point, cell):
    got = filled([point])[0]
    assert got.sum() == 1
    assert got[cell]


@pytest.mark.parametrize("point", [[1, 0, -0.9], [1, 0, 9], [21, 0, 0]])
def test_floor_sky_and_the_far_count_nowhere(point):
    assert filled([point]).sum() == 0


def test_the_height_above_the_floor_decides_not_the_mount():
    points = np.random.default_rng(0).uniform([-15, -15, -0.8], [15, 15, 3], (500, 3)).astype(np.float32)
    assert np.array_equal(filled(points, 1.0), filled(points - np.float32([0, 0, 0.5]), 1.5))


@pytest.mark.parametrize("turn", [0, 1, 17, 35])
def test_key_ignores_the_turn_and_best_shifts_finds_it(turn):
    rng = np.random.default_rng(turn)
    template = rng.random((1, GRID.rows, 36)) < 0.2
    query = np.roll(template, -turn, axis=2)  # the robot turned by +turn sectors sees all at -turn
    assert np.allclose(ring_spectrum(template), ring_spectrum(query), atol=1e-5)
    shift, score = best_shifts(query[0], template.astype(np.uint8))
    assert shift.tolist() == [turn]
    assert score[0] == pytest.approx(1)


def test_best_shifts_scores_the_right_template_highest():
    rng = np.random.default_rng(3)
    templates = (rng.random((20, GRID.rows, 36)) < 0.2).astype(np.uint8)
    query = np.roll(templates[7].astype(bool), 5, axis=1)
    query[:, :6] = False  # a sixth of the view is blocked
    shift, score = best_shifts(query, templates)
    assert score.argmax() == 7
    assert shift[7] == 31
    assert score[7] < 1


def test_an_empty_scan_gives_a_key_and_scores_of_zero():
    empty = filled(np.empty((0, 3)))
    assert np.isfinite(ring_spectrum(empty)).all()
    _, score = best_shifts(empty[0], np.ones((2, GRID.rows, 36), np.uint8))
    assert score.tolist() == [0, 0]
