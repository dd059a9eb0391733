"""The range view: which directions count when a scan is held against the map."""

import numpy as np

from firstfix.scan.reduction import COLUMNS, ROWS, RangeView


def nearest(rows, columns=slice(None)) -> np.ndarray:
    """(cells,) ranges with returns in some rows and columns."""
    image = np.full((ROWS, COLUMNS), np.inf, np.float32)
    image[rows, columns] = 4.0
    return image.ravel()


def counted(of_nearest: np.ndarray) -> np.ndarray:
    return RangeView.of_nearest(of_nearest).returned.reshape(ROWS, COLUMNS)


def test_the_edges_of_the_field_of_view_do_not_count():
    found = counted(nearest(slice(40, 52)))
    assert np.array_equal(found, np.isfinite(nearest(slice(41, 51))).reshape(ROWS, COLUMNS))
    assert found[45].all()  # columns wrap around


def test_what_lies_beside_a_hole_does_not_count():
    image = nearest(slice(30, 60)).reshape(ROWS, COLUMNS).copy()
    image[44:47, 100:103] = np.inf
    found = counted(image.ravel())
    assert not found[43:48, 101].any()
    assert found[43, 99]  # the corner has eight of nine
    assert found[42, 101]


def test_in_a_scan_of_single_rows_each_direction_counts():
    sparse = nearest(slice(40, 52, 2))
    assert np.array_equal(counted(sparse).ravel(), np.isfinite(sparse))


def test_nothing_counts_where_nothing_is_seen():
    assert not counted(nearest(slice(0, 0))).any()


def test_the_nearest_range_is_that_of_the_cell_and_those_around():
    image = nearest(slice(None)).reshape(ROWS, COLUMNS).copy()
    image[20, 0] = 1.0
    least = RangeView.of_nearest(image.ravel()).least.reshape(ROWS, COLUMNS)
    assert np.argwhere(least == 1.0).tolist() == [[r, c] for r in (19, 20, 21) for c in (0, 1, COLUMNS - 1)]
