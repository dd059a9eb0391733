"""Scans of a query as one surface, and the times of a range view: the compiled core against NumPy."""

from __future__ import annotations

import numpy as np

from firstfix import native
from firstfix.engine.registration.surface import Surface
from firstfix.scan.reduction import COLUMNS, directions, nearest_by_direction
from firstfix.transform import inverse, make_transform, product, rotation_z

T = make_transform(rotation_z(0.7), [4.0, -2.0, 0.3])


def a_surface(rng: np.random.Generator, count: int, time_s: np.ndarray | None = None) -> Surface:
    normals = rng.normal(size=(count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    points = rng.uniform(-20, 20, (count, 3)).astype(np.float32)
    return Surface(points, normals.astype(np.float32), rng.random(count) < 0.5, time_s)


def joined(parts: list[tuple[np.ndarray, Surface]], dense: int, sparse: int) -> list[Surface]:
    numbers = [(pose, one.points, one.normals, one.oriented, one.time_s) for pose, one in parts]
    return [
        Surface(points, normals, oriented.view(np.bool_), time_s)
        for points, normals, oriented, time_s in native.joined_scans(numbers, 0.3, dense, sparse)
    ]


def test_scans_are_joined_in_the_last_frame():
    rng = np.random.default_rng(3)
    first = a_surface(rng, 700)
    last = a_surface(rng, 500, rng.uniform(-0.05, 0.05, 500).astype(np.float32))
    whole, part = joined([(T, first), (np.eye(4), last)], 5000, 200)
    wanted = Surface.together([first.moved(T), last])
    np.testing.assert_allclose(whole.points, wanted.points, atol=1e-5)
    np.testing.assert_allclose(whole.normals, wanted.normals, atol=1e-6)
    np.testing.assert_array_equal(whole.oriented, wanted.oriented)
    np.testing.assert_array_equal(whole.time_s, wanted.time_s)
    np.testing.assert_array_equal(part.points, whole.at_most(200, 0.3).points)
    assert joined([(T, first)], 5000, 200)[0].time_s is None


def test_a_view_has_the_times_of_its_columns():
    rng = np.random.default_rng(4)
    points = rng.uniform(-20, 20, (3000, 3)).astype(np.float32)
    points = points[np.abs(np.arctan2(points[:, 1], points[:, 0])) < 2.5]  # some columns have no point
    azimuth = np.arctan2(points[:, 1], points[:, 0])
    time_s = (azimuth / (2 * np.pi) * 0.1).astype(np.float32)
    nearest_m = nearest_by_direction(rng.uniform(-20, 20, (9000, 3)).astype(np.float32))
    returned, found_s = native.timed_view(points, time_s, nearest_m, directions())
    seen = np.flatnonzero(np.isfinite(nearest_m))
    np.testing.assert_array_equal(returned, directions()[seen] * nearest_m[seen, None])
    column = ((azimuth / (2 * np.pi) + 0.5) * COLUMNS).astype(int) % COLUMNS
    known = np.unique(column)
    mean_s = [time_s[column == one].astype(np.float64).mean() for one in known]
    wanted_s = np.interp(seen % COLUMNS, known, mean_s)
    np.testing.assert_allclose(found_s, wanted_s, atol=1e-7)


def test_a_view_of_no_points_is_of_no_time():
    nearest_m = np.full(len(directions()), 3.0, np.float32)
    nothing = np.empty((0, 3), np.float32), np.empty(0, np.float32)
    assert not native.timed_view(*nothing, nearest_m, directions())[1].any()


def test_products_and_inverses_are_those_of_matrices():
    rng = np.random.default_rng(5)
    other = make_transform(rotation_z(-2.0), rng.normal(size=3))
    np.testing.assert_allclose(product(T, other), T @ other, atol=1e-14)
    np.testing.assert_allclose(product(T, inverse(T)), np.eye(4), atol=1e-14)
