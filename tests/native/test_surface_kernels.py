"""Kernels of surfaces: normals of neighbours, and thinning."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

import firstfix.native as native
from firstfix.engine.registration.surface import Surface
from firstfix.engine.registration.surface_grid_build import BLOCK_BITS, CellsOf, tables_around
from tests.every_case import every_case
from tests.native.test_scan_kernels import CLOUD, METRES, SCANS, WILD_CLOUD, scan
from tests.reference.registration import nearest_points
from tests.reference.surface import neighbour_scatter, neighbour_scatter_by_side, thinned


def spread_along(normals: NDArray[np.floating], scatter: NDArray[np.float64]) -> NDArray[np.float64]:
    """Variance of the neighbours along each normal."""
    return np.einsum("ni,nij,nj->n", normals, scatter, normals)


@pytest.mark.parametrize("place", SCANS)
def test_normals_are_the_axes_of_least_spread(place: str):
    points = native.voxel_means(scan(place), 0.3)[:6000].astype(np.float32)
    normals, oriented = native.surface_normals(points, -points)
    scatter, clear = neighbour_scatter(points)
    variance, axes = np.linalg.eigh(scatter)
    clear &= variance[:, 1] > 2 * variance[:, 0]
    assert clear.mean() > 0.5
    off_deg = np.degrees(np.arccos(np.abs(np.einsum("ij,ij->i", normals, axes[:, :, 0])).clip(0, 1)))
    assert off_deg[clear].max() < 1.0
    assert np.allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-5)
    along = np.einsum("ij,ij->i", normals, -points)
    assert (along >= 0).all()
    sine = along / np.linalg.norm(points, axis=1)
    assert (oriented.view(np.bool_) == (sine > 0.1))[np.abs(sine - 0.1) > 1e-5].all()


def test_points_on_the_other_face_count_as_further_away():
    rng = np.random.default_rng(3)
    points = rng.uniform([0, 0, -0.01], [3, 3, 0.01], (1000, 3)).astype(np.float32)
    upper = np.arange(1000)[:, None] < 500
    points -= np.where(upper, 0, np.float32([0, 0, 0.2]))
    to_viewer = np.where(upper, np.float32([0.3, 0, 1]), np.float32([0.3, 0, -1]))
    normals, _ = native.surface_normals(points, to_viewer, two_faces=True)
    facing = to_viewer
    for _ in range(3):
        scatter, clear = neighbour_scatter_by_side(points, to_viewer, facing)
        axis = np.linalg.eigh(scatter)[1][:, :, 0]
        along = np.einsum("ij,ij->i", axis, to_viewer)
        sure = np.abs(along) > 0.1 * np.linalg.norm(to_viewer, axis=1)
        facing = axis * (np.sign(along) * sure)[:, None]
    least, most = np.linalg.eigvalsh(scatter)[:, [0, 2]].T
    assert clear.mean() > 0.9
    assert (spread_along(normals, scatter) <= least + 1e-4 * most)[clear].all()
    blind, _ = native.surface_normals(points, to_viewer)
    assert (spread_along(blind, scatter) > least + 1e-2 * most)[clear].mean() > 0.2


@settings(max_examples=150)
@given(CLOUD)
def test_any_points_have_unit_normals_along_which_they_spread_least(points: NDArray[np.float32]):
    normals, oriented = native.surface_normals(points)
    assert normals.shape == points.shape
    assert not oriented.any()
    assert np.allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-5)
    if len(points) == 0:
        return
    scatter, clear = neighbour_scatter(points)
    least, most = np.linalg.eigvalsh(scatter)[:, [0, 2]].T
    assert (spread_along(normals, scatter) <= least + 1e-4 * most + 1e-12)[clear].all()


@settings(max_examples=100)
@given(WILD_CLOUD)
def test_points_that_are_not_finite_are_refused(points: NDArray[np.float32]):
    if not (np.abs(points) <= 1e15).all():
        with pytest.raises(ValueError, match="not finite, too far away"):
            native.surface_normals(points)
        return
    normals, _ = native.surface_normals(points, np.full_like(points, np.nan))
    assert np.isfinite(normals).all()


@every_case("count", [1, 2, 9, 10, 11, 16, 17, 33, 500])
def test_points_in_one_place_have_normals_too(count: int):
    normals, _ = native.surface_normals(np.tile(np.float32([3, -2, 1]), (count, 1)))
    assert np.allclose(np.linalg.norm(normals, axis=1), 1)


def test_the_order_of_points_makes_no_difference():
    points = np.random.default_rng(4).uniform(-5, 5, (700, 3)).astype(np.float32)
    order = np.random.default_rng(5).permutation(len(points))
    normals, shuffled = native.surface_normals(points)[0], native.surface_normals(points[order])[0]
    np.testing.assert_allclose(np.abs(np.einsum("ij,ij->i", normals[order], shuffled)), 1, atol=1e-4)


def test_normals_need_one_direction_for_each_point():
    with pytest.raises(ValueError, match="one direction for each point"):
        native.surface_normals(np.zeros((4, 3)), np.zeros((3, 3)))


def same(one: Surface, other: Surface) -> bool:
    return all(
        np.array_equal(getattr(one, name), getattr(other, name)) for name in ("points", "normals", "oriented")
    )


def thinned_by_kernel(surface: Surface, voxel_m: float) -> Surface:
    made = native.thin_surface(surface.points, surface.normals, surface.oriented, voxel_m)
    return Surface(made[0], made[1], made[2].view(np.bool_))


@pytest.mark.parametrize("place", SCANS)
def test_a_recorded_surface_is_thinned_to_the_same_bits(place: str):
    whole = Surface.around(scan(place)[:20_000], -scan(place)[:20_000])
    for voxel_m in (0.2, 1.0, 7.0):
        assert same(thinned_by_kernel(whole, voxel_m), thinned(whole, voxel_m))


@settings(max_examples=100)
@given(st.data(), st.integers(1, 40))
def test_any_surface_is_thinned_to_the_same_bits(data: Any, count: int):
    points = data.draw(arrays(np.float32, (count, 3), elements=METRES))
    normals = data.draw(arrays(np.float32, (count, 3), elements=st.floats(-1, 1, width=32)))
    oriented = data.draw(arrays(np.bool_, count))
    whole = Surface(points, normals, oriented)
    assert same(thinned_by_kernel(whole, 0.5), thinned(whole, 0.5))


def test_a_surface_of_unequal_parts_is_refused():
    points = np.zeros((4, 3), np.float32)
    for normals, oriented in ((points[:3], np.ones(4, np.bool_)), (points, np.ones(5, np.bool_))):
        with pytest.raises(ValueError, match="one normal for each point"):
            native.thin_surface(points, normals, oriented, 0.5)
    with pytest.raises(ValueError, match="not finite"):
        native.thin_surface(points * np.nan, points, np.ones(4, np.bool_), 0.5)
    assert len(native.thin_surface(points[:0], points[:0], np.ones(0, np.bool_), 0.5)[0]) == 0


@pytest.mark.parametrize("place", SCANS)
def test_the_nearest_points_of_cells_are_numpys(place: str):
    cells = CellsOf.points(native.voxel_means(scan(place), 0.3)[:4000].astype(np.float32), 0.25)
    group, block = tables_around(cells)
    cell, offset = cells.of(slice(None))
    row = np.arange(len(cell), dtype=np.int32)
    count = int(block.max()) + 1
    for first, end in ((1, count), (count // 3, count // 2)):
        found = native.nearest_points(cell, offset, row, group, block, BLOCK_BITS, first, end)
        assert np.array_equal(found, nearest_points(cells, group, block, first, end))
        assert (found >= 0).any()
