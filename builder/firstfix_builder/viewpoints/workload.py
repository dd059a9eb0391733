"""Estimates of the templates that a map would get, before the work that they take is begun.

A file of 200 bytes can be a plain of 100 square kilometres. Its templates would take days, and nobody else's
builds would have a turn.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from firstfix.builds.config import ViewpointConfig
from firstfix.builds.limits import DEFAULT_MAX_TEMPLATES
from firstfix.errors import BuildFailed

from ..mesh.tiled_mesh import TiledMesh
from .sample import DEFAULT_SPACING_M
from .tiles import Tiling

# Most of a large map is no floor. To look for floors at a place takes a tenth of the time of a template.
PLACES_A_TEMPLATE = 10
FOOTPRINT_CELL_M = 8.0
LINE_M = 0.01
_TRIANGLES_AT_ONCE = _POINTS_AT_ONCE = 1_000_000
_SETTING = "FIRSTFIX_BUILD_MAX_TEMPLATES"


@dataclass(frozen=True)
class Workload:
    """Limit on the estimated templates of a map.

    Attributes:
        max_templates: None: no limit.
    """

    max_templates: int | None = DEFAULT_MAX_TEMPLATES

    def check_cloud(
        self,
        points: NDArray[np.float64],
        poses: NDArray[np.float64] | None,
        config: ViewpointConfig,
    ) -> None:
        """Check (n, 3) points before their surface is made.

        Args:
            poses: (m, 4, 4) of the trajectory, or None.

        Raises:
            BuildFailed: they lie on a line, or spread over too large an area.
        """
        if len(points) > 1 and _widths_m(points)[1] < LINE_M:
            raise BuildFailed(f"the map has no surface: its {len(points)} points lie on a line")
        if self.max_templates is not None:
            area_m2 = _cells(points, FOOTPRINT_CELL_M) * FOOTPRINT_CELL_M**2
            self._check_extent(area_m2, poses, config, config.spacing_m or DEFAULT_SPACING_M)

    def check_mesh(
        self,
        mesh: TiledMesh,
        poses: NDArray[np.float64] | None,
        config: ViewpointConfig,
        spacing_m: float,
    ) -> None:
        """Check a surface before floors are looked for.

        Raises:
            BuildFailed: there is too much floor, or it is spread too far.
        """
        if self.max_templates is None:
            return
        tiling = Tiling(spacing_m)
        area_m2 = len(tiling.over(mesh.low, mesh.high)) * tiling.side_m**2
        if area_m2 / spacing_m**2 > self.max_templates:  # else its floors are too small in any case
            floor_m2 = min(_level_m2(mesh, config.max_slope_deg), _within_m2(poses, config))
            self._check(floor_m2, spacing_m)
        self._check_extent(area_m2, poses, config, spacing_m)

    def check_found(self, templates: int, spacing_m: float) -> None:
        """Check the number of templates before they are made.

        Raises:
            BuildFailed: too many.
        """
        self._check(templates * spacing_m**2, spacing_m)

    def _check(self, floor_m2: float, spacing_m: float) -> None:
        templates = floor_m2 / spacing_m**2
        if self.max_templates is not None and templates > self.max_templates:
            raise BuildFailed(
                f"the map is too large: its floors of {floor_m2:,.0f} m2 would get about {templates:,.0f} "
                f"templates, one every {spacing_m:g} m, and the limit is {self.max_templates:,}: "
                + self._advice(floor_m2)
            )

    def _check_extent(
        self, area_m2: float, poses: NDArray[np.float64] | None, config: ViewpointConfig, spacing_m: float
    ) -> None:
        """Compare the area in which floors are looked for with the limit."""
        area_m2 = min(area_m2, _within_m2(poses, config))
        places = area_m2 / spacing_m**2
        if self.max_templates is not None and places > PLACES_A_TEMPLATE * self.max_templates:
            raise BuildFailed(
                f"the map is too large: on its extent of {area_m2:,.0f} m2 there is room for about "
                f"{places:,.0f} templates, one every {spacing_m:g} m, and the limit is {PLACES_A_TEMPLATE} "
                f"times {self.max_templates:,}: {self._advice(area_m2)}"
            )

    def _advice(self, area_m2: float) -> str:
        assert self.max_templates is not None
        fitting_m = np.ceil(10 * np.sqrt(area_m2 / self.max_templates)) / 10
        return (
            f"set viewpoints.spacing_m to {fitting_m:g} or viewpoints.max_distance_to_trajectory_m, split "
            f"the map, or raise the limit ({_SETTING})"
        )


def _widths_m(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3,) standard deviations along the main axes, largest first."""
    middle, moments = points.mean(axis=0), np.zeros((3, 3))
    for first in range(0, len(points), _POINTS_AT_ONCE):
        part = points[first : first + _POINTS_AT_ONCE] - middle
        moments += part.T @ part
    return np.sqrt(np.maximum(np.linalg.eigvalsh(moments / len(points))[::-1], 0.0))


def _cells(points: NDArray[np.float64], cell_m: float) -> int:
    """Number of squares of the ground plane that hold points."""
    column, row = np.floor(points[:, :2] / cell_m).T
    return len(np.unique(column + 1j * row))


def _within_m2(poses: NDArray[np.float64] | None, config: ViewpointConfig) -> float:
    """Area around the trajectory in which templates may stand."""
    reach_m = config.max_distance_to_trajectory_m
    if reach_m is None or poses is None or not len(poses):
        return np.inf
    steps = np.array([(x, y, 0.0) for x in (-1, 0, 1) for y in (-1, 0, 1)]) * reach_m
    first = np.unique(np.floor(poses[:, :3, 3] / reach_m)[:, :2], axis=0) * reach_m
    places = np.column_stack([first + reach_m / 2, np.zeros(len(first))])
    return _cells((places[:, None] + steps).reshape(-1, 3), reach_m) * reach_m**2


def _level_m2(mesh: TiledMesh, max_slope_deg: float) -> float:
    """Area of the triangles that are level enough to stand on, seen from above."""
    area_m2, steepest = 0.0, np.cos(np.radians(max_slope_deg))
    for first in range(0, len(mesh.mesh.triangles), _TRIANGLES_AT_ONCE):
        corners = mesh.mesh.vertices[mesh.mesh.triangles[first : first + _TRIANGLES_AT_ONCE]]
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        up = np.abs(normal[:, 2])
        area_m2 += float(up[up >= steepest * np.linalg.norm(normal, axis=1)].sum()) / 2
    return area_m2
