"""Scans of a query as one surface, and the times of a range view: the compiled core against NumPy."""

from __future__ import annotations

import numpy as np

from firstfix import native
from firstfix.engine.config import PreprocessConfig
from firstfix.engine.preprocess import preprocess
from firstfix.engine.ranking import RANKING
from firstfix.engine.registration.surface import Surface
from firstfix.scan.reduction import COLUMNS, directions, nearest_by_direction
from firstfix.scan.scan import Scan
from firstfix.scan.sequence import ScanSequence
from firstfix.transform import inverse, make_transform, product, rotation_z

T = make_transform(rotation_z(0.7), [4.0, -2.0, 0.3])


def a_scan(seed: int, count: int, *, in_time: bool = False) -> Scan:
    rng = np.random.default_rng(seed)
    points = rng.uniform(-20, 20, (count, 3)).astype(np.float32)
    return Scan(points, time_s=rng.uniform(-0.05, 0.05, count).astype(np.float32) if in_time else None)


def test_scans_are_joined_in_the_last_frame():
    ranking = RANKING.model_copy(update={"dense_points": 5000, "sparse_points": 200})
    sequence = ScanSequence((a_scan(3, 700), a_scan(4, 500, in_time=True)), (T, np.eye(4)))
    query = preprocess(sequence, None, PreprocessConfig(), ranking=ranking)
    assert query is not None
    first, last = query.scans
    wanted = Surface.together([first.thinned.moved(T), last.thinned])
    assert len(wanted) > 1000
    np.testing.assert_allclose(query.dense.points, wanted.points, atol=1e-5)
    np.testing.assert_allclose(query.dense.normals, wanted.normals, atol=1e-6)
    np.testing.assert_array_equal(query.dense.oriented, wanted.oriented)
    np.testing.assert_array_equal(query.dense.time_s, wanted.time_s)
    np.testing.assert_array_equal(query.sparse.points, query.dense.at_most(200, 0.25).points)


def test_a_scan_before_the_last_one_has_no_times():
    sequence = ScanSequence((a_scan(3, 700, in_time=True), a_scan(4, 500)), (T, np.eye(4)))
    query = preprocess(sequence, None, PreprocessConfig())
    assert query is not None
    assert query.dense.time_s is None


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
