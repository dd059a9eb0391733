"""The first stage: a map cloud without stray points, no denser than it has to be."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from firstfix.bit_exact.sample import rows_by_chance
from firstfix.builds.config import CleanConfig
from firstfix.errors import BuildFailed
from firstfix.native import column_means, with_neighbours

from .bounds import in_all
from .places.chance import SPACING_STEPS, stepped

SPACING_SAMPLES = 50_000
RING = 8  # the neighbours of a point of a raster
RING_RADIUS = 2**0.5  # the corners of that ring, in spacings; for random points it is 1.6
VOXEL_GROWTH = 1.25


def clean_cloud(points: NDArray[np.float64], config: CleanConfig) -> NDArray[np.float64]:
    """(n, 3 or more) rows to m <= n, in an order that depends on the points alone: x, y, z in metres.

    Columns after the coordinates change nothing. Where points are thinned, they are averaged too.

    Raises:
        BuildFailed: nothing is left.
    """
    is_finite = np.isfinite(points[:, :3])
    cloud = points if is_finite.all() else points[in_all(is_finite)]
    if config.voxel_m is not None:
        cloud = voxel_means(cloud, config.voxel_m)
    voxel_m = config.voxel_m or 0.0
    while len(cloud) > config.max_points:
        voxel_m = max(voxel_m * VOXEL_GROWTH, point_spacing_m(cloud[:, :3]))
        cloud = voxel_means(cloud, voxel_m)
    if config.min_neighbours and len(cloud) > config.min_neighbours:
        spacing_m = stepped(point_spacing_m(cloud[:, :3]), SPACING_STEPS)
        cloud = without_strays(cloud, config.radius_spacings * spacing_m, config.min_neighbours)
    if len(cloud) == 0:
        raise BuildFailed("no point of the map is left after cleaning")
    return cloud


def voxel_means(points: NDArray[np.float64], voxel_m: float) -> NDArray[np.float64]:
    """The mean of the points in every occupied voxel, (m, 3 or more), in x-y-z order of the voxels.

    Columns after the coordinates are averaged too.
    """
    try:
        return column_means(points, voxel_m)
    except ValueError:
        raise _too_wide(points, f"voxels of {voxel_m} m") from None


def _too_wide(points: NDArray[np.float64], what: str) -> BuildFailed:
    width_m = float(np.ptp(points[:, :3], axis=0).max())
    return BuildFailed(
        f"the map is {width_m:,.0f} m wide: too large for {what}. "
        "Remove stray points far away from all others"
    )


def without_strays(points: NDArray[np.float64], radius_m: float, min_neighbours: int) -> NDArray[np.float64]:
    """Keep those of (n, 3 or more) rows that have at least so many others within the radius."""
    at = np.ascontiguousarray(points[:, :3])
    try:
        kept = with_neighbours(at, radius_m, min_neighbours)
    except ValueError:
        raise _too_wide(points, f"neighbourhoods of {radius_m:.3g} m") from None
    return points[kept.view(np.bool_)]


def point_spacing_m(points: NDArray[np.float64]) -> float:
    """Median distance from a point to its nearest neighbour, from a sample of (n, 3) points."""
    if len(points) < 2:
        raise BuildFailed("a map of less than two points")
    some = points[rows_by_chance(len(points), SPACING_SAMPLES)]
    nearest = _quick_tree(points).query(some, k=2)[0][:, 1]
    nearest = nearest[nearest > 0]
    if len(nearest) == 0:
        raise BuildFailed("the points of the map coincide")
    return float(np.median(nearest))


def surface_spacings_m(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Edges (k,) of the squares of surface that k points of a sample of (n, 3) points stand for.

    From the distance to the eighth neighbour: on a raster it is the spacing of the raster, and unlike
    the nearest neighbour's it does not shrink where points fall at random.
    """
    if len(points) <= RING:
        raise BuildFailed(f"a map of {len(points)} points")
    some = points[rows_by_chance(len(points), SPACING_SAMPLES)]
    ring = _quick_tree(points).query(some, k=[RING + 1])[0][:, 0]
    ring = ring[ring > 0]
    if len(ring) == 0:
        raise BuildFailed("the points of the map coincide")
    return ring / RING_RADIUS


def _quick_tree(points: NDArray[np.float64]) -> cKDTree:
    """A tree that is made in half the time of a balanced one, and finds the same distances."""
    return cKDTree(points, balanced_tree=False, compact_nodes=False)
