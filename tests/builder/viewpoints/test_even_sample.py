import numpy as np
import pytest

from firstfix_builder.viewpoints.even_sample import rows_by_hash, rows_by_place


def columns(storeys=2, side=40):
    """Viewpoints as the build orders them: column by column, lower storey then upper."""
    x, y = np.meshgrid(np.arange(side, dtype=float), np.arange(side, dtype=float), indexing="ij")
    floor = np.stack([x.ravel(), y.ravel()], axis=1)
    each = [np.column_stack([floor, np.full(len(floor), 1.0 + 3 * storey)]) for storey in range(storeys)]
    return np.stack(each, axis=1).reshape(-1, 3)


@pytest.mark.parametrize("at_most", [100, 400, 800, 1600])
def test_each_storey_gets_its_share(at_most):
    points = columns()
    upper = (points[rows_by_place(points, at_most, 3.0)][:, 2] > 2).mean()
    assert upper == pytest.approx(0.5, abs=0.13)


def test_crowded_places_get_no_more_than_lonely_ones():
    rng = np.random.default_rng(1)
    crowd = rng.uniform(0, 3, (5000, 3))
    lonely = np.arange(100)[:, None] * [3.0, 0, 0] + [10.5, 1.5, 1.5]
    rows = rows_by_place(np.concatenate([crowd, lonely]), 120, 3.0)
    assert len(rows) == 120
    assert (rows >= 5000).sum() == 100  # each lonely one before the crowd's second
    assert (np.diff(rows) > 0).all()


def test_all_points_where_there_are_no_more():
    points = columns(side=5)
    assert rows_by_place(points, 50, 3.0).tolist() == list(range(50))
    assert rows_by_place(points[:0], 5, 3.0).tolist() == []


def test_the_same_seed_gives_the_same_rows():
    points = columns()
    np.testing.assert_array_equal(
        rows_by_place(points, 99, 3.0, seed=3), rows_by_place(points, 99, 3.0, seed=3)
    )


def test_by_hash_a_storey_or_a_corner_gets_its_share_too():
    points = columns()
    upper = (points[rows_by_hash(points, 200, 3.0)][:, 2] > 2).mean()
    assert 0.4 < upper < 0.6
    crowd = np.random.default_rng(2).uniform(0, 3, (3000, 3)) * [1, 1, 0]
    lonely = columns(storeys=1, side=10) + [50.0, 50.0, 0.0]
    chosen = rows_by_hash(np.concatenate([crowd, lonely]), 60, 3.0)
    assert (chosen >= len(crowd)).mean() > 0.5
    assert rows_by_hash(points[:7], 7, 3.0).tolist() == list(range(7))


def test_by_hash_a_choice_of_choices_of_tiles_is_the_choice_of_all_in_any_order():
    points = columns()
    rng = np.random.default_rng(5)
    whole = {tuple(point) for point in points[rows_by_hash(points, 150, 2.0)]}
    assert len(whole) == 150
    shuffled = points[rng.permutation(len(points))]
    tile = np.floor(shuffled[:, 0] / 8)
    parts = [shuffled[tile == number] for number in np.unique(tile)]
    kept = np.concatenate([part[rows_by_hash(part, 150, 2.0)] for part in parts])
    assert len(kept) < len(points)
    assert {tuple(point) for point in kept[rows_by_hash(kept, 150, 2.0)]} == whole


def test_by_hash_a_change_elsewhere_makes_few_others_of_the_chosen():
    points = columns()
    before = {tuple(point) for point in points[rows_by_hash(points, 200, 2.0)]}
    left = points[(points[:, 0] > 4) | (points[:, 1] > 4)]
    after = {tuple(point) for point in left[rows_by_hash(left, 200, 2.0)]}
    assert len(before & after) >= 190
