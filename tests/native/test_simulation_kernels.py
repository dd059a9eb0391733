"""The ray caster against Embree, and the surfaces that returns lie on against NumPy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from firstfix.descriptor import LayeredOccupancy, PolarGrid
from firstfix.native import SeenSurface, TriangleTree, bundle_rays, column_means
from firstfix.sensor import preset
from firstfix_builder.mesh.open3d_core import o3d
from firstfix_builder.simulation.perturb import elsewhere
from firstfix_builder.simulation.rays import Rays
from firstfix_builder.simulation.simulate import Simulator, upright
from firstfix_builder.templates.make import scan_batch
from tests.every_case import every_case

NO_LIMIT_M = 1e6


@pytest.fixture(scope="module")
def yard() -> Simulator:
    return Simulator(*elsewhere(np.random.default_rng(3)))


@pytest.fixture(scope="module")
def hills() -> Simulator:
    """80,000 small triangles without a gap."""
    x, y = np.meshgrid(np.linspace(-20, 20, 201), np.linspace(-20, 20, 201), indexing="ij")
    z = np.sin(x) * np.cos(1.3 * y) + 0.3 * np.sin(5 * x + y) - 2
    row = np.arange(201 * 201).reshape(201, 201)
    a, b, c, d = (part.ravel() for part in (row[:-1, :-1], row[1:, :-1], row[:-1, 1:], row[1:, 1:]))
    triangles = np.concatenate([np.column_stack([a, b, c]), np.column_stack([b, d, c])])
    return Simulator(np.column_stack([x.ravel(), y.ravel(), z.ravel()]), triangles)


def directions(count: int, seed: int = 0) -> np.ndarray:
    rays = np.random.default_rng(seed).normal(size=(count, 3))
    return (rays / np.linalg.norm(rays, axis=1, keepdims=True)).astype(np.float32)


@pytest.mark.parametrize("place", ["yard", "hills"])
def test_ranges_are_embrees(place: str, request: pytest.FixtureRequest):
    simulator = request.getfixturevalue(place)
    origins = np.random.default_rng(1).uniform([-18, -18, -1.5], [18, 18, 4], (40, 3))
    for rays in (
        Rays.of_sensor(preset("os0-64").coarser(4000)),
        Rays.of(directions(999)),
        Rays.of(directions(5)),
    ):
        found = simulator._tree.ranges(origins.astype(np.float32), rays.directions, rays.order, 0, NO_LIMIT_M)
        wanted = simulator.cast(
            np.repeat(origins, len(rays), axis=0), np.tile(rays.directions, (len(origins), 1))
        ).reshape(found.shape)
        met = np.isfinite(wanted)
        assert met.any()
        edges = np.isfinite(found) != met  # a ray along an edge may be met by one alone
        assert edges.mean() < 1e-4
        off_m = np.abs(found[met & ~edges] - wanted[met & ~edges])
        assert np.percentile(off_m, 99.9) < 1e-3
        assert (off_m > 0.01).mean() < 1e-4  # past an edge: then it is another surface's range


def test_no_ray_slips_between_triangles():
    """Rays through the edges of a closed rock around the origin."""
    rng = np.random.default_rng(2)
    points = directions(5000, seed=2) * rng.uniform(4, 5, (5000, 1)).astype(np.float32)
    triangles = ConvexHull(points / np.linalg.norm(points, axis=1, keepdims=True)).simplices.astype(np.uint32)
    tree, origin = TriangleTree(points, triangles), np.zeros((1, 3), np.float32)
    corners = points[triangles]
    on_edge = corners[:, 0] + (corners[:, 1] - corners[:, 0]) * rng.uniform(0, 1, (len(corners), 1))
    rays = (on_edge / np.linalg.norm(on_edge, axis=1, keepdims=True)).astype(np.float32)
    ranges = tree.ranges(origin, rays, bundle_rays(rays), 0, NO_LIMIT_M)[0]
    assert np.abs(ranges - np.linalg.norm(on_edge, axis=1)).max() < 1e-3


def test_the_order_of_rays_and_origins_changes_no_bit(hills: Simulator):
    rays, origins = directions(1003), np.random.default_rng(4).uniform(-9, 9, (37, 3)).astype(np.float32)
    whole = hills._tree.ranges(origins, rays, bundle_rays(rays), 0.5, 30)
    shuffled = np.random.default_rng(5).permutation(len(rays)).astype(np.uint32)
    assert np.array_equal(whole, hills._tree.ranges(origins, rays, shuffled, 0.5, 30))
    single = [hills._tree.ranges(one[None], rays, bundle_rays(rays), 0.5, 30) for one in origins]
    assert np.array_equal(whole, np.concatenate(single))


def test_bundles_hold_each_ray_once_and_neighbours():
    rays = preset("os1-128").directions()
    order = bundle_rays(rays)
    assert np.array_equal(np.sort(order), np.arange(len(rays)))
    bundles = rays[order].reshape(-1, 16, 3)
    middle = bundles.mean(axis=1, keepdims=True)
    cosine = (bundles * middle).sum(axis=2) / np.linalg.norm(middle, axis=2)
    assert np.degrees(np.arccos(np.clip(cosine, -1, 1))).max() < 3


def test_ranges_end_at_the_limits():
    floor = np.float32([[-50, -50, 0], [50, -50, 0], [0, 80, 0]])
    tree = TriangleTree(floor, np.uint32([[0, 1, 2]]))
    down = np.float32([[0, 0, -1]])
    heights = np.float32([[0, 0, h] for h in (0.5, 1.0, 2.0, 3.0, 3.001)])
    found = tree.ranges(heights, down, np.uint32([0]), 1.0, 3.0)[:, 0]
    assert np.array_equal(found, np.float32([np.inf, 1, 2, 3, np.inf]))


def test_ranges_beyond_a_range_are_those_to_the_next_surface(hills: Simulator):
    origin = np.float32([[1.0, 2.0, 3.0]])
    rays = directions(3001)
    order = bundle_rays(rays)
    first = hills._tree.ranges(origin, rays, order, 0, 30)[0]
    at_once = hills._tree.ranges_beyond(origin[0], rays, order, np.zeros(3001, np.float32), 30)
    assert np.array_equal(at_once, first)
    met = np.flatnonzero(np.isfinite(first))
    order = bundle_rays(rays[met])
    second = hills._tree.ranges_beyond(origin[0], rays[met], order, first[met], 30)
    assert (second > first[met]).all()
    past = first[met] + np.float32(1e-3)  # past the first surface, from where Embree starts anew
    wanted = past + hills.cast(origin + rays[met] * past[:, None], rays[met])
    wanted[wanted > 30] = np.inf
    both = np.isfinite(wanted) & np.isfinite(second)
    assert both.sum() > 100
    assert (np.isfinite(wanted) != np.isfinite(second)).mean() < 0.01
    assert np.percentile(np.abs(second[both] - wanted[both]), 97) < 1e-2
    assert np.isinf(hills._tree.ranges_beyond(origin[0], rays[met], order, first[met] * 0 + np.inf, 30)).all()


def test_a_tree_of_any_shape_is_searched():
    """Triangles in one place, along a line at growing steps, and flat ones."""
    x = np.float32(2.0) ** np.arange(-60, 29)
    far = np.stack(
        [np.column_stack([x, 0 * x + dy, 0 * x + dz]) for dy, dz in ((-1, -1), (1, -1), (0, 1))], axis=1
    )
    same = np.tile(np.float32([[[4, -1, -1], [4, 1, -1], [4, 0, 1]]]), (300, 1, 1))
    flat = np.zeros((20, 3, 3), np.float32)
    vertices = np.concatenate([far, same, flat]).reshape(-1, 3)
    tree = TriangleTree(vertices, np.arange(len(vertices), dtype=np.uint32).reshape(-1, 3))
    ahead = np.float32([[1, 0, 0]])
    found = tree.ranges(np.float32([[3, 0, 0], [5, 0, 0]]), ahead, np.uint32([0]), 0, 1e8)
    assert np.array_equal(found, np.float32([[1], [3]]))


def test_near_surfaces_are_embrees(yard: Simulator):
    points = np.random.default_rng(6).uniform([-30, -30, 0], [30, 30, 6], (3000, 3))
    distance = yard.distance(points)
    for radius_m in (0.05, 0.3, 2.0):
        sure = np.abs(distance - radius_m) > 1e-5
        assert np.array_equal(yard.is_free(points, radius_m)[sure], (distance >= radius_m)[sure])


@pytest.mark.parametrize("place", ["yard", "hills"])
def test_cells_seen_are_those_of_the_scans(place: str, request: pytest.FixtureRequest):
    simulator = request.getfixturevalue(place)
    rng = np.random.default_rng(9)
    origins = rng.uniform([-18, -18, 0.5], [18, 18, 4], (70, 3)).astype(np.float32)
    height_m = rng.uniform(-1, 4, 70).astype(np.float32)  # above its floor, or below it
    for sensor, edges_m in (
        (preset("os0-64").coarser(4000), (0.3, 1.0, 1.8, 3.0, 6.0, 25.0)),
        (preset("vlp-16"), (-2.0, 0.0, 0.5)),
    ):
        for range_m in (8.0, 60.0):
            descriptor = LayeredOccupancy(PolarGrid(20, 60, range_m), edges_m)
            rays = Rays.of_sensor(sensor)
            found = simulator.occupied_cells(origins, height_m, sensor, rays, descriptor)
            ranges = np.concatenate(list(simulator.ranges(upright(origins), sensor, rays)))
            wanted = descriptor.describe(scan_batch(ranges, rays.directions, height_m))["occupancy"]
            assert 0 < np.unpackbits(wanted).mean() < 1
            assert np.array_equal(found, wanted)


def test_crossings_are_embrees(yard: Simulator, hills: Simulator):
    for simulator in (yard, hills):
        columns = np.random.default_rng(10).uniform(-19, 19, (500, 2))
        start, z, level = simulator.crossings(columns, 0.0, 200)
        assert len(z) >= 500
        over = np.repeat(columns, np.diff(start), axis=0)
        above = np.column_stack([over, z + 0.01])
        hit = simulator.scene.cast_rays(
            o3d.core.Tensor(np.column_stack([above, np.tile([0, 0, -1.0], (len(z), 1))]).astype(np.float32))
        )
        assert np.percentile(np.abs(hit["t_hit"].numpy() - 0.01), 99) < 1e-4
        steepness = np.abs(hit["primitive_normals"].numpy()[:, 2])
        assert np.percentile(np.abs(steepness - level), 98) < 1e-4
        first = start[:-1][np.diff(start) > 0]
        top = np.column_stack([over[first], np.full(len(first), 50.0)])
        drop = simulator.cast(top, np.tile([0, 0, -1.0], (len(first), 1)))
        assert np.abs(50 - drop - z[first]).max() < 1e-4
        same_column = np.diff(np.repeat(np.arange(len(columns)), np.diff(start))) == 0
        assert (np.diff(z)[same_column] <= 0).all()


def test_near_crossings_are_one_surface_and_few_are_kept(yard: Simulator):
    columns = np.random.default_rng(11).uniform(-30, 30, (400, 2))
    start, z, _ = yard.crossings(columns, 0.5, 200)
    same_column = np.diff(np.repeat(np.arange(400), np.diff(start))) == 0
    assert (np.diff(z)[same_column] <= -0.5).all()
    start, highest, _ = yard.crossings(columns, 0.5, 1)
    assert np.diff(start).max() == 1
    assert set(highest) <= set(z)


def test_the_height_of_a_surface_does_not_depend_on_the_rest_of_the_mesh(hills: Simulator):
    tower = np.array([[90.0, 90, 700], [91, 90, 700], [90, 91, 700]])
    corners = hills._vertices[hills._triangles].reshape(-1, 3)
    more = Simulator(np.concatenate([tower, corners]), np.arange(len(corners) + 3).reshape(-1, 3))
    columns = np.random.default_rng(12).uniform(-19, 19, (300, 2))
    for one, other in zip(hills.crossings(columns, 0.02, 9), more.crossings(columns, 0.02, 9), strict=True):
        assert np.array_equal(one, other)


def test_free_ways_are_embrees(yard: Simulator):
    rng = np.random.default_rng(13)
    starts, ends = rng.uniform([-20, -20, 0], [20, 20, 5], (2, 3000, 3)).astype(np.float32)
    ends[:1500] = starts[:1500] + (ends[:1500] - starts[:1500]) / 20
    way = ends - starts
    length = np.linalg.norm(way, axis=1)
    range_m = yard.cast(starts, way / length[:, None])
    sure = np.abs(range_m - length) > 1e-4
    free = yard.is_way_free(starts, ends)
    assert 0.2 < free.mean() < 0.9
    assert np.array_equal(free[sure], (range_m >= length)[sure])
    assert np.array_equal(free[sure], yard.is_way_free(ends, starts)[sure])


def test_means_of_what_is_seen():
    rng = np.random.default_rng(7)
    origins, rays = rng.uniform(-3, 3, (60, 3)).astype(np.float32), directions(500)
    ranges = rng.uniform(0.5, 9, (60, 500)).astype(np.float32)
    ranges[rng.random(ranges.shape) < 0.2] = np.inf
    surface = SeenSurface(0.25)
    for start in range(0, 60, 7):  # in parts
        surface.add(origins[start : start + 7], rays, ranges[start : start + 7])
    scan, ray = np.nonzero(np.isfinite(ranges))
    points = origins[scan].astype(np.float64) + rays[ray] * ranges[scan, ray][:, None]
    wanted = column_means(np.column_stack([points, -rays[ray]]), 0.25)
    found = surface.means()
    assert found.shape == (len(wanted), 7)
    assert np.abs(found[:, :6] - wanted).max() < 1e-6
    assert found[:, 6].sum() == len(points)
    assert SeenSurface(0.25).means().shape == (0, 7)


def test_column_means_are_numpys():
    rng = np.random.default_rng(8)
    rows = np.column_stack([rng.uniform(-5, 5, (20_000, 3)), rng.normal(size=(20_000, 2))])
    cell = np.floor(rows[:, :3] / 0.3).astype(np.int64)
    _, voxel, count = np.unique(cell, axis=0, return_inverse=True, return_counts=True)
    sums = np.stack([np.bincount(voxel.ravel(), weights=column) for column in rows.T], axis=1)
    assert np.array_equal(column_means(rows, 0.3), sums / count[:, None])


FLOOR = np.float32([[0, 0, 0], [1, 0, 0], [0, 1, 0]])
CORNERS = np.uint32([[0, 1, 2]])
TREE = TriangleTree(FLOOR, CORNERS)
UP, FIRST = np.float32([[0, 0, 1]]), np.uint32([0])
CELLS = (UP, UP[0, 2:], UP, FIRST, 0.0, 9.0, 5, 8, 9.0, np.float32([0, 1]))  # all that is right
REFUSED = {
    "no triangle": lambda: TriangleTree(FLOOR, CORNERS[:0]),
    "a vertex that is not there": lambda: TriangleTree(FLOOR, CORNERS + np.uint32(1)),
    "a vertex that is no number": lambda: TriangleTree(FLOOR * np.float32(np.nan), CORNERS),
    "a vertex too far away": lambda: TriangleTree(FLOOR * np.float32(3e9), CORNERS),
    "an origin that is no number": lambda: TREE.ranges(UP * np.nan, UP, FIRST, 0, 9),
    "a direction that is none": lambda: TREE.ranges(UP, UP * 3, FIRST, 0, 9),
    "a row that is not there": lambda: TREE.ranges(UP, UP, FIRST + np.uint32(1), 0, 9),
    "rows of other rays": lambda: TREE.ranges(UP, UP, FIRST[:0], 0, 9),
    "limits out of order": lambda: TREE.ranges(UP, UP, FIRST, 9, 0),
    "a limit that is no number": lambda: TREE.ranges(UP, UP, FIRST, 0, np.nan),
    "a negative range": lambda: TREE.ranges_beyond(UP[0], UP, FIRST, np.float32([-1]), 9),
    "a range that is no number": lambda: TREE.ranges_beyond(UP[0], UP, FIRST, np.float32([np.nan]), 9),
    "a range of another ray": lambda: TREE.ranges_beyond(UP[0], UP, FIRST, np.float32([1, 1]), 9),
    "a row beyond that is not there": lambda: TREE.ranges_beyond(
        UP[0], UP, FIRST + np.uint32(1), np.float32([1]), 9
    ),
    "a limit beyond that is no number": lambda: TREE.ranges_beyond(UP[0], UP, FIRST, np.float32([1]), np.nan),
    "cells of an origin without a height": lambda: TREE.occupied_cells(*CELLS[:1], UP[0, :0], *CELLS[2:]),
    "cells at a height that is no number": lambda: TREE.occupied_cells(UP, UP[0, 2:] * np.nan, *CELLS[2:]),
    "cells of a row that is not there": lambda: TREE.occupied_cells(
        *CELLS[:3], FIRST + np.uint32(1), *CELLS[4:]
    ),
    "cells of no layer": lambda: TREE.occupied_cells(*CELLS[:-1], np.float32([1])),
    "cells of a grid without rings": lambda: TREE.occupied_cells(*CELLS[:6], 0, *CELLS[7:]),
    "a column that is no number": lambda: TREE.crossings(np.array([[0, np.nan]]), 0.0, 1),
    "no surface of a column": lambda: TREE.crossings(np.zeros((1, 2)), 0.0, 0),
    "surfaces at a negative distance": lambda: TREE.crossings(np.zeros((1, 2)), -1.0, 1),
    "ways without ends": lambda: TREE.free_ways(UP, UP[:0]),
    "a way that is no number": lambda: TREE.free_ways(UP, UP * np.nan),
    "a point that is no number": lambda: TREE.near_surface(UP * np.nan, 1),
    "bundles of no rays": lambda: bundle_rays(UP * np.nan),
    "voxels of no size": lambda: SeenSurface(0),
    "ranges of other rays": lambda: SeenSurface(1).add(UP, UP, np.zeros((1, 2), np.float32)),
    "returns too far away": lambda: SeenSurface(1e-6).add(UP, UP, np.float32([[99]])),
    "rows that are too short": lambda: column_means(np.zeros((4, 2)), 0.1),
    "rows that are no numbers": lambda: column_means(np.full((4, 3), np.nan), 0.1),
    "rows too far apart": lambda: column_means(np.array([[0, 0, 0], [1e30, 0, 0.0]]), 0.1),
}


@every_case("name", REFUSED)
def test_invalid_arguments_of_the_ray_caster_are_refused(name: str):
    with pytest.raises((ValueError, IndexError, TypeError)):
        REFUSED[name]()
