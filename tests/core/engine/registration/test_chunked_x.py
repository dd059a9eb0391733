"""Thinning slab by slab gives the same points as thinning at once."""

import numpy as np
import pytest

from firstfix.engine.registration import chunked_x as chunked_x_module
from firstfix.engine.registration.chunked_x import chunked_x
from firstfix.engine.registration.surface import Surface
from firstfix.engine.verification.point_tiles import PointTiles

RNG = np.random.default_rng(3)
POINTS = RNG.uniform([-40, -20, 0], [35, 20, 4], (20_000, 3)).astype(np.float32)


@pytest.fixture(params=[1, 700, 5000])
def few(request, monkeypatch):
    monkeypatch.setattr(chunked_x_module, "MOST_POINTS", request.param)
    return request.param


def test_slabs_are_whole_voxels_in_order_and_no_larger_than_they_need_be(few):
    parts = [POINTS[rows] for rows in chunked_x(POINTS, 0.5)]
    assert sum(map(len, parts)) == len(POINTS)
    layers = [np.unique(np.floor(part[:, 0] / 0.5)) for part in parts]
    assert (np.diff(np.concatenate(layers)) > 0).all()
    assert all(len(part) <= few or len(own) == 1 for part, own in zip(parts, layers, strict=True))


def test_a_surface_is_thinned_the_same(few, monkeypatch):
    normals = RNG.normal(size=POINTS.shape).astype(np.float32)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    surface = Surface(POINTS, normals, RNG.random(len(POINTS)) < 0.7)
    found = surface.thinned(0.8)
    monkeypatch.setattr(chunked_x_module, "MOST_POINTS", 1_000_000)
    whole = surface.thinned(0.8)
    assert np.array_equal(found.points, whole.points)
    assert np.array_equal(found.normals, whole.normals)
    assert np.array_equal(found.oriented, whole.oriented)


def test_tiles_hold_the_same_points(few, monkeypatch):
    found = PointTiles.of(POINTS, 0.4)
    monkeypatch.setattr(chunked_x_module, "MOST_POINTS", 1_000_000)
    whole = PointTiles.of(POINTS, 0.4)
    assert np.array_equal(found.begin, whole.begin)
    assert np.array_equal(*(one.points[np.lexsort(one.points.T)] for one in (found, whole)))
