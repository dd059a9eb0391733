import numpy as np
import pytest

from firstfix_builder.index import top_view
from firstfix_builder.index.top_view import PIXELS, TopView


def test_pixels_tell_how_high_and_how_many_points_are_and_lie_where_they_are():
    points = np.array([[2.0, 5.0, 0.0], [2.0, 5.0, 3.0], [20.0, 5.0, -1.0], [2.0, 14.0, 2.0]])
    view = TopView.of(points)
    rows, columns = view.height_m.shape
    assert columns == pytest.approx(PIXELS, abs=1)
    assert rows == pytest.approx(PIXELS / 2, abs=1)
    west, east, south, north = view.extent_m
    assert (west, south) == (2.0, 5.0)
    assert east >= 20
    assert north >= 14
    seen = np.argwhere(view.opacity > 0)
    assert len(seen) == 3
    for (row, column), point, height_m in zip(seen, points[[0, 2, 3]], (1.5, -1.0, 2.0), strict=True):
        middle = np.array([column, row]) + 0.5
        at = [west, south] + middle * [(east - west) / columns, (north - south) / rows]
        assert np.abs(at - point[:2]).max() < 0.02
        assert view.height_m[row, column] == height_m
    two, *single = view.opacity[tuple(seen.T)]
    assert 0 < single[0] == single[1] < two < 1


def test_points_in_one_place_are_a_view():
    assert TopView.of(np.ones((3, 3))).height_m.tolist() == [[1.0]]
    assert np.isfinite(TopView.of(np.ones((3, 3))).opacity).all()


def test_of_many_points_some_are_drawn_everywhere(monkeypatch):
    points = np.random.default_rng(4).uniform([0, 0, 0], [90, 30, 2], (200_000, 3))
    whole = TopView.of(points)
    monkeypatch.setattr(top_view, "MAX_POINTS", 50_000)
    some = TopView.of(points)
    assert some.extent_m == pytest.approx(whole.extent_m, abs=2 * whole.pixel_m)
    rows, columns = (min(one) for one in zip(some.opacity.shape, whole.opacity.shape, strict=True))
    cells = [
        view.opacity[: rows // 30 * 30, : columns // 30 * 30].reshape(rows // 30, 30, columns // 30, 30)
        for view in (some, whole)
    ]
    drawn, full = ((one > 0).mean(axis=(1, 3)) for one in cells)
    assert np.all(drawn > 0.1)
    assert np.all(drawn < full)
