"""One block of the map as a surface: where the signed distance from the planes of its cells is zero.

The signed distance of a place is the mean over the planes around it, weighted by nearness (H. Hoppe et al.,
"Surface reconstruction from unorganized points", SIGGRAPH 1992). Surface nets (S. F. Gibson, 1998) make
the triangles.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from firstfix.bit_exact.sample import rows_by_chance
from firstfix.errors import BuildFailed
from firstfix.native import cell_planes, surface_net

from .map_tiles import Block
from .mesh import Mesh, middle
from .orient_normals import orient_normals
from .places.chance import SPACING_STEPS, VIEW_STEPS, stepped

RANGE_SAMPLES = 50_000
MIN_RANGE_M = 0.5
DENSEST = 0.1  # of the points


@dataclass(frozen=True)
class Sampling:
    """Spacing of a cloud's points against their range from the nearest place of the scanner.

    Rays spread: the points of a surface become fewer with the square of its range. At short range the voxel
    grid of the map holds them all, and they become no denser.

    Attributes:
        spacing_m: of the points at the usual range: the medians over the cloud.
        range_m: the usual range.
        dense_spacing_m: of the densest tenth of the points, or less.
    """

    spacing_m: float
    range_m: float
    dense_spacing_m: float

    @classmethod
    def of(
        cls, points: NDArray[np.float64], spacings_m: NDArray[np.float64], places: NDArray[np.float64]
    ) -> Sampling:
        """Measure in coarse steps: a change in a part of the map leaves them as they are, as a rule.

        Args:
            points: (n, 3) metres, of which a sample is measured.
            spacings_m: (k,) at some of the points.
            places: (m, 3) where the scanner was.
        """
        some = points[rows_by_chance(len(points), RANGE_SAMPLES)]
        range_m = float(np.median(cKDTree(places).query(some)[0]))
        dense_m, median_m = np.quantile(spacings_m, [DENSEST, 0.5])
        return cls(
            stepped(float(median_m), SPACING_STEPS),
            stepped(max(range_m, MIN_RANGE_M), VIEW_STEPS),
            stepped(float(dense_m), VIEW_STEPS),
        )

    def points_on(self, area_m2: float, range_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """The (n,) points that a surface of this area has at (n,) ranges."""
        near = self.spacing_m * np.maximum(range_m, 1e-9) / self.range_m
        points: NDArray[np.float64] = area_m2 / np.maximum(near, self.dense_spacing_m) ** 2
        return points


PLANE_CELLS = 4.0  # around a cell of a plane are the points of so many cells, as cell_planes counts
CORE_SHARE = 1 / 2  # of the points that a surface has at this range
BORDER_SHARE = 1 / 3  # of these, beside such a cell: at an edge, or in a gap
REACH_CELLS = 2.0  # less leaves holes at the foot of walls and between sparse rings, more rounds corners
MAX_TRIM_CELLS = 4.0


def signed_distance_mesh(
    points: NDArray[np.float64],
    places: NDArray[np.float64] | None,
    block: Block,
    *,
    cell_m: float,
    sampling: Sampling | None,
    trim_m: float,
    sight_voxel_m: float,
) -> Mesh:
    """The surface through (n, 3) points of a block and its margin: triangles with their middle in the block.

    The cells have corners at multiples of their edge, so neighbours make the same triangles at their border.

    Args:
        points: metres.
        places: (m, 3) where the scanner was, or None.
        block: what the result answers for.
        cell_m: edge of a cell.
        sampling: of the cloud; None: thin surface stays wherever it is.
        trim_m: surface further than this from the points goes.
        sight_voxel_m: grain of the line-of-sight test that orients the normals.

    Raises:
        BuildFailed: a point is over a million cells away from the origin.
    """
    try:
        means, normals, weights, supports, best = cell_planes(points, cell_m)
        near = means
        if sampling is not None and places is not None and len(places):
            full = PLANE_CELLS * sampling.points_on(cell_m**2, cKDTree(places).query(means)[0])
            dense = (best >= CORE_SHARE * full) & (supports >= BORDER_SHARE * full)
            means, normals, weights = means[dense], normals[dense], weights[dense]
        if len(means) == 0:
            return Mesh.empty()
        normals = orient_normals(means, normals, places, sight_voxel_m)
        trim_cells = min(trim_m / cell_m, MAX_TRIM_CELLS)
        vertices, triangles = surface_net(means, normals, weights, near, cell_m, REACH_CELLS, trim_cells)
    except ValueError as error:
        raise BuildFailed(f"no surface of cells of {cell_m:.3g} m: {error}") from None
    is_ours = block.holds(middle(vertices[triangles]))
    return Mesh(vertices, triangles.astype(np.int64)).with_triangles(is_ours)
