"""Alignment of a scan with the map's surface, from many start poses at once.

Point to plane, weighted by the agreement of the two normals, as the covariances of GICP would be
(docs/method.md section 7). First on a coarse grid of the map, which attracts poses within a metre, then on
the map's own points. The kernel is ``native/include/firstfix/registration/align.hpp``.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ... import native
from ...native import SLOW_M_S, SLOW_RAD_S
from ...transform import Matrix
from ..config import RegistrationConfig
from ..made_of import MadeOf, always
from ..ranking import RANKING, RankingConfig
from .surface import Surface
from .surface_grid import SurfaceGrid

# Where walls face one way only, an alignment creeps a few centimetres an iteration. A dozen do elsewhere.
_FINE_ITERATIONS = 60
_FINE_FILE, _COARSE_FILE = "surface_fine.safetensors", "surface_coarse.safetensors"


@dataclass(frozen=True)
class Registration:
    """Aligned pose of a scan.

    Attributes:
        T_level_sensor: (4, 4) in the index's frame.
        inlier_ratio: 0..1, share of the scan's points within ``inlier_distance_m`` of the map's surface.
        alignment_score: 0..1, the same, but a point counts less the further it lies from the surface. It
            tells the true minimum from one beside it, which the inlier ratio alone does not.
        information: (6, 6) over rotation then translation, about the sensor and along the level axes.
        rests: whether the alignment came to rest. One that was still moving is never the answer.
        twist: (6,) of the sensor during the scan, if it was solved: m/s then rad/s, in the sensor frame at
            the scan's stamp. The pose is that at the stamp, and the quality that of the deskewed scan.
    """

    T_level_sensor: Matrix
    inlier_ratio: float
    alignment_score: float
    information: NDArray[np.float64]
    rests: bool = True
    twist: NDArray[np.float64] | None = None

    @property
    def is_in_motion(self) -> bool:
        """Whether a motion was solved that moves points by more than a few centimetres."""
        if self.twist is None:
            return False
        fast = np.linalg.norm(self.twist[:3]) > SLOW_M_S or np.linalg.norm(self.twist[3:]) > SLOW_RAD_S
        return bool(fast)


@dataclass(frozen=True)
class Agreement:
    """Agreement of a placed scan with the map, beyond the share that agrees.

    Attributes:
        beside_surface: 0..1, share of the scan's points that lie near a surface of the map (in a cell of the
            coarse grid that has one), but on none (in no such cell of the fine grid).
        same_plane: 0..1, chance that two of the scan's upright points within ``inlier_distance_m`` lie on one
            plane; 1 without two such points.
    """

    beside_surface: float
    same_plane: float


@dataclass(frozen=True)
class Registrations:
    """Aligned poses of a scan, from k starts. Item i is a ``Registration``, which explains the attributes.

    Attributes:
        T_level_sensor: (k, 4, 4).
        inlier_ratio: (k,).
        alignment_score: (k,).
        information: (k, 6, 6).
        rests: (k,).
        twist: (k, 6), or None.
    """

    T_level_sensor: NDArray[np.float64]
    inlier_ratio: NDArray[np.float64]
    alignment_score: NDArray[np.float64]
    information: NDArray[np.float64]
    rests: NDArray[np.bool_]
    twist: NDArray[np.float64] | None = None

    def __len__(self) -> int:
        return len(self.T_level_sensor)

    def __getitem__(self, number: int) -> Registration:
        return Registration(
            self.T_level_sensor[number],
            float(self.inlier_ratio[number]),
            float(self.alignment_score[number]),
            self.information[number],
            bool(self.rests[number]),
            None if self.twist is None else self.twist[number],
        )

    def __iter__(self) -> Iterator[Registration]:
        return (self[number] for number in range(len(self)))


@dataclass(frozen=True)
class MapSurface:
    """Map surface to register against. Thread-safe.

    Attributes:
        config: parameters of the registration.
        fine: grid of the map's own points.
        coarse: grid of the map, thinned.
        ranking: the numbers of the map.
    """

    config: RegistrationConfig
    fine: SurfaceGrid
    coarse: SurfaceGrid
    ranking: RankingConfig = RANKING

    @classmethod
    def of(cls, surface: Surface, config: RegistrationConfig, made_of: MadeOf = always) -> MapSurface:
        """Map surface from points with normals.

        Args:
            surface: thinned to about ``map_voxel_m``.
            made_of: makes the parts of tiles, or takes those of an earlier build with the same surface there.
        """
        coarse = surface.thinned(config.coarse_voxel_m / 2)
        fine = SurfaceGrid.of(surface, config.map_voxel_m, made_of)
        return cls(config, fine, SurfaceGrid.of(coarse, config.coarse_voxel_m, made_of))

    def save(self, directory: Path) -> None:
        """Write the grids to a version's files."""
        self.fine.save(directory / _FINE_FILE)
        self.coarse.save(directory / _COARSE_FILE)

    @classmethod
    def load(
        cls, directory: Path, config: RegistrationConfig, ranking: RankingConfig = RANKING
    ) -> MapSurface:
        """Read a version's files, memory-mapped."""
        fine, coarse = SurfaceGrid.load(directory / _FINE_FILE), SurfaceGrid.load(directory / _COARSE_FILE)
        return cls(config, fine, coarse, ranking)

    def screen(
        self, scan: Surface, T_level_sensor: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Moves thousands of (k, 4, 4) starts a little towards the map, on the coarse grid with few points.

        Without these steps a start half a metre off scores no better than a wrong one (docs/method.md
        section 7.1).

        Returns:
            (k, 4, 4) poses, and (k,) their alignment scores, 0..1, within one coarse cell.
        """
        return self._on_coarse_grid(
            scan, T_level_sensor, self.ranking.screen_points, self.ranking.screen_iterations
        )

    def align_coarse(
        self, scan: Surface, T_level_sensor: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Align on the coarse grid: (k, 4, 4) starts within about a metre end within a few decimetres.

        Returns:
            See ``screen``.
        """
        return self._on_coarse_grid(
            scan, T_level_sensor, self.ranking.coarse_points, self.config.coarse_iterations
        )

    def align(self, scan: Surface, T_level_sensor: NDArray[np.float64]) -> Registrations:
        """Align on the map's own points, from (k, 4, 4) starts within a few decimetres."""
        reach_m, iterations = self.config.fine_distance_m, self.config.align_iterations
        return self._align(self.fine, scan, T_level_sensor, iterations, reach_m, self.ranking.align_angle)

    def align_smoothly(self, scan: Surface, T_level_sensor: NDArray[np.float64]) -> Registrations:
        """Align on the map's own points with little regard to normals, from (k, 4, 4) aligned poses.

        Starts within two decimetres end near one pose. From there ``align_fine`` goes to one of its minima.
        """
        reach_m = self.config.fine_distance_m
        return self._align(
            self.fine,
            scan,
            T_level_sensor,
            self.ranking.smooth_iterations,
            reach_m,
            self.ranking.smooth_angle,
        )

    def align_fine(
        self,
        scan: Surface,
        T_level_sensor: NDArray[np.float64],
        iterations: int = _FINE_ITERATIONS,
        *,
        twist: NDArray[np.float64] | None = None,
    ) -> Registrations:
        """Align on the map's own points until nothing moves, from (k, 4, 4) aligned poses.

        Where the times of the scan's points are known, the motion during the scan is solved too.

        Args:
            scan: as it was taken, not deskewed.
            twist: (k, 6) with which the motion begins, if it is solved: that by which the scan was deskewed
                where the poses were aligned. None: at rest.
        """
        reach_m, half_angle = self.config.fine_distance_m, self.ranking.fine_angle
        if scan.time_s is not None:
            twist = np.zeros((len(T_level_sensor), 6)) if twist is None else twist
            return self._align_moving(
                scan, scan.time_s, T_level_sensor, twist, iterations, reach_m, half_angle
            )
        return self._align(self.fine, scan, T_level_sensor, iterations, reach_m, half_angle)

    def agreements(self, scan: Surface, T_level_sensor: NDArray[np.float64]) -> list[Agreement]:
        """Agreement of the scan with the map at each of (k, 4, 4) poses."""
        found = native.agreement(
            self.fine.tables,
            self.coarse.tables,
            scan.points,
            scan.normals,
            scan.oriented,
            T_level_sensor,
            self.config.inlier_distance_m,
        )
        return [Agreement(*one) for one in zip(*(values.tolist() for values in found), strict=True)]

    def _on_coarse_grid(
        self, scan: Surface, T_level_sensor: NDArray[np.float64], points: int, iterations: int
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        voxel_m, half_angle = self.config.coarse_voxel_m, self.ranking.coarse_angle
        few, reach_m = scan.at_most(points, voxel_m), 1.5 * voxel_m
        found = self._align(self.coarse, few, T_level_sensor, iterations, reach_m, half_angle, voxel_m)
        return found.T_level_sensor, found.alignment_score

    def _align_moving(
        self,
        scan: Surface,
        time_s: NDArray[np.float32],
        T_start: NDArray[np.float64],
        twist_start: NDArray[np.float64],
        iterations: int,
        reach_m: float,
        half_angle: float,
    ) -> Registrations:
        aligned = native.align_moving(
            self.fine.tables,
            scan.points,
            scan.normals,
            scan.oriented,
            time_s,
            T_start,
            twist_start,
            np.array(self.ranking.twist_scale),
            iterations,
            reach_m,
            half_angle,
            self.config.inlier_distance_m,
        )
        T, inlier_ratio, score, information, rests, twist = aligned
        return Registrations(T, inlier_ratio, score, information, rests.view(np.bool_), twist)

    def _align(
        self,
        grid: SurfaceGrid,
        scan: Surface,
        T_start: NDArray[np.float64],
        iterations: int,
        reach_m: float,
        half_angle: float,
        inlier_distance_m: float | None = None,
    ) -> Registrations:
        aligned = native.align(
            grid.tables,
            scan.points,
            scan.normals,
            scan.oriented,
            T_start,
            iterations,
            reach_m,
            half_angle,
            self.config.inlier_distance_m if inlier_distance_m is None else inlier_distance_m,
        )
        T, inlier_ratio, score, information, rests = aligned
        return Registrations(T, inlier_ratio, score, information, rests.view(np.bool_))
