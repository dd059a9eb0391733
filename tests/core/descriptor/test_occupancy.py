import numpy as np
import pytest

from firstfix.descriptor import LayeredOccupancy, PolarGrid, ScanBatch

OCCUPANCY = LayeredOccupancy(PolarGrid(10, 36, 20.0), (0.3, 1.0, 2.0, 8.0))


def described(points, height_m=1.0):
    return OCCUPANCY.describe(ScanBatch.single(np.asarray(points, np.float32), height_m))


def filled(points, height_m=1.0):
    return OCCUPANCY.filled(described(points, height_m))


def stored(filled):
    return {"occupancy": np.packbits(filled.reshape(len(filled), -1), axis=1)}


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
def test_keys_ignore_the_turn_and_match_finds_it(turn):
    rng = np.random.default_rng(turn)
    template = rng.random((1, OCCUPANCY.rows, 36)) < 0.2
    query = np.roll(template, -turn, axis=2)  # the robot turned by +turn sectors sees all at -turn
    assert np.allclose(OCCUPANCY.keys(stored(template)), OCCUPANCY.keys(stored(query)), atol=1e-5)
    yaw, score = OCCUPANCY.match(stored(query), stored(template), np.arange(1))
    assert yaw == pytest.approx([turn * 2 * np.pi / 36])
    assert score[0] == pytest.approx(1)


def test_match_scores_the_right_template_highest():
    rng = np.random.default_rng(3)
    templates = rng.random((20, OCCUPANCY.rows, 36)) < 0.2
    query = np.roll(templates[7:8], 5, axis=2)
    query[:, :, :6] = False  # a sixth of the view is blocked
    yaw, score = OCCUPANCY.match(stored(query), stored(templates), np.arange(20))
    assert score.argmax() == 7
    assert yaw[7] == pytest.approx(31 * 2 * np.pi / 36)
    assert score[7] < 1


def test_similarity_is_the_cosine_as_the_cells_lie():
    rng = np.random.default_rng(5)
    a, b = (rng.random((n, OCCUPANCY.rows, 36)) < 0.3 for n in (3, 4))
    expected = [[(x & y).sum() / np.sqrt(x.sum() * y.sum()) for y in b] for x in a]
    assert np.allclose(OCCUPANCY.similarity(stored(a), stored(b)), expected, atol=1e-6)


def test_an_empty_scan_gives_a_key_and_scores_of_zero():
    empty = described(np.empty((0, 3)))
    assert np.isfinite(OCCUPANCY.keys(empty)).all()
    _, score = OCCUPANCY.match(empty, stored(np.ones((2, OCCUPANCY.rows, 36), bool)), np.arange(2))
    assert score.tolist() == [0, 0]
