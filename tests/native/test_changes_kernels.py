"""Kernels that compare a scan with its map, against NumPy."""

from __future__ import annotations

import numpy as np
import pytest

import firstfix.native as native
from firstfix.engine.changes.block import SIZE, Block
from firstfix.engine.registration.surface import Surface
from firstfix.engine.registration.surface_grid import SurfaceGrid
from firstfix.engine.verification.point_tiles import PointTiles
from firstfix.transform import make_transform, rotation_z
from tests.native.kernel_cases import FEW, STREET, T_MAP_SENSOR
from tests.reference import changes

NEAR, FAR = PointTiles.of(STREET, 0.1), PointTiles.of(STREET, 0.4)
AT = make_transform(rotation_z(0.7), [3.2, -1.1, 0.3])


def returns(seed: int) -> np.ndarray:
    """The street as it is seen at AT, some of it nearer and some further away, with noise."""
    rng = np.random.default_rng(seed)
    seen = (STREET - AT[:3, 3].astype(np.float32)) @ AT[:3, :3].astype(np.float32)
    scale = rng.choice([0.5, 1.0, 1.3], len(seen), p=[0.2, 0.6, 0.2])
    return np.ascontiguousarray(seen * scale[:, None] + rng.normal(0, 0.02, seen.shape), np.float32)


@pytest.mark.parametrize("columns", [180, 360])
def test_mapped_points_are_compared_as_in_numpy(columns: int):
    scan = returns(1)
    mapped, gone, met = native.compare_points(NEAR.tables, FAR.tables, 9.0, 25.0, AT, scan, columns)
    np.testing.assert_array_equal(mapped, changes.points_around(NEAR, FAR, AT, 9.0, 25.0))
    expected = changes.compared(mapped, scan, columns)
    np.testing.assert_array_equal(gone, expected[0])
    np.testing.assert_array_equal(met, expected[1])
    assert gone.sum() > 20
    assert met.sum() > 500


def test_returns_are_explained_as_in_numpy():
    scan = returns(2)
    upright = np.tile(np.float32([0, 0, 1]), (len(FEW), 1))
    fine, coarse = (SurfaceGrid.of(Surface(FEW, upright, upright[:, 2] > 0), cell) for cell in (0.5, 1.5))
    around = np.float32([[0, 0, 0], [0.3, 0, 0], [0, -0.3, 0]])
    below = np.float32([[0, 0, -0.5], [0, 0, -1.5]])
    mapped = changes.points_around(NEAR, FAR, AT, 9.0, 25.0)
    found = native.unexplained_returns(scan, mapped, fine.tables, coarse.tables, AT, around, below, 25.0)
    np.testing.assert_array_equal(
        found, changes.unexplained(scan, mapped, fine, coarse, AT, around, below, 25.0)
    )
    assert 200 < found.sum() < len(scan) / 2


def test_cells_are_counted_as_in_numpy():
    rng = np.random.default_rng(3)
    block = Block.around(T_MAP_SENSOR)
    mapped, scan = FEW, returns(4)[:5000]
    gone, met = rng.random((2, len(mapped))) < 0.3
    new = rng.random(len(scan)) < 0.5
    rays = scan[:700] / np.linalg.norm(scan[:700], axis=1, keepdims=True)
    until_m = rng.uniform(-1, 24, len(rays)).astype(np.float32)
    cells, counts = native.cell_counts(
        block.turn, block.start, SIZE, mapped, gone, met, scan, new, rays, until_m, 0.5
    )
    parts = (mapped[gone], mapped[met], scan[new], changes.ends_of_steps(rays, until_m, 0.5))
    expected = np.stack([changes.count(block.turn, block.start, SIZE, part) for part in parts], axis=1)
    np.testing.assert_array_equal(cells, np.flatnonzero(expected.any(axis=1)))
    np.testing.assert_array_equal(counts, expected[cells])


def test_nothing_seen_and_nothing_mapped_compares_to_nothing():
    nothing = np.empty((0, 3), np.float32)
    far_away = make_transform(np.eye(3), [1e5, 0, 0])
    mapped, gone, met = native.compare_points(NEAR.tables, FAR.tables, 9.0, 25.0, far_away, nothing, 360)
    assert len(mapped) == len(gone) == len(met) == 0
