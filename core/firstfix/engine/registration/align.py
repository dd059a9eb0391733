"""Alignment of a scan with the map's surface, from many start poses at once.

Point to plane, weighted by the agreement of the two normals, as the covariances of GICP would be
(docs/method.md section 7). First on a coarse grid of the map, which attracts poses within a metre, then on
the map's own points. All starts go through one set of NumPy calls: twenty together cost as much as three one
by one.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ...transform import Matrix
from ..config import RegistrationConfig
from .surface import Surface
from .surface_grid import SurfaceGrid

_COARSE_POINTS = 200
_COARSE_ANGLE, _FINE_ANGLE = 0.2, 0.06  # sine between normals at which a pair counts half
_OTHER_FACE = -0.2  # cosine: normals further apart face opposite ways, even with noise
_STILL_M, _STILL_RAD = 5e-4, 1e-4
_DAMPING = 1e-4  # of a pair's weight: keeps the pose along directions that the scan does not constrain
_FINE_FILE, _COARSE_FILE = "surface_fine.safetensors", "surface_coarse.safetensors"
_NOISE_M = 0.01  # standard deviation of a scan point's distance from the map, at least


@dataclass(frozen=True)
class Registration:
    """Aligned pose of a scan.

    Attributes:
        T_level_sensor: (4, 4) in the index's frame.
        inlier_ratio: 0..1, share of the scan's points within ``inlier_distance_m`` of the map's surface.
        alignment_score: 0..1, the same, but a point counts less the further it lies from the surface. It
            tells the true minimum from one beside it, which the inlier ratio alone does not.
        information: (6, 6) over rotation then translation, about the sensor and along the level axes.
    """

    T_level_sensor: Matrix
    inlier_ratio: float
    alignment_score: float
    information: NDArray[np.float64]


@dataclass(frozen=True)
class MapSurface:
    """Map surface to register against. Thread-safe.

    Attributes:
        config: parameters of the registration.
        fine: grid of the map's own points.
        coarse: grid of the map, thinned.
    """

    config: RegistrationConfig
    fine: SurfaceGrid
    coarse: SurfaceGrid

    @classmethod
    def of(cls, surface: Surface, config: RegistrationConfig) -> MapSurface:
        """Map surface from points with normals.

        Args:
            surface: thinned to about ``map_voxel_m``.
        """
        coarse = surface.thinned(config.coarse_voxel_m / 2)
        fine = SurfaceGrid.of(surface, config.map_voxel_m)
        return cls(config, fine, SurfaceGrid.of(coarse, config.coarse_voxel_m))

    def save(self, directory: Path) -> None:
        """Writes the grids to a version's files."""
        self.fine.save(directory / _FINE_FILE)
        self.coarse.save(directory / _COARSE_FILE)

    @classmethod
    def load(cls, directory: Path, config: RegistrationConfig) -> MapSurface:
        """Reads a version's files, memory-mapped."""
        fine, coarse = SurfaceGrid.load(directory / _FINE_FILE), SurfaceGrid.load(directory / _COARSE_FILE)
        return cls(config, fine, coarse)

    def align_coarse(self, scan: Surface, T_level_sensor: NDArray[np.float64]) -> NDArray[np.float64]:
        """Aligns on the coarse grid: (k, 4, 4) starts within about a metre end within a few decimetres."""
        reach_m, few = 1.5 * self.config.coarse_voxel_m, scan.at_most(_COARSE_POINTS)
        iterations = self.config.coarse_iterations
        return _align(self.coarse, few, T_level_sensor, iterations, reach_m, _COARSE_ANGLE).T_level_sensor

    def align(self, scan: Surface, T_level_sensor: NDArray[np.float64]) -> list[Registration]:
        """Aligns on the map's own points, from (k, 4, 4) starts within a few decimetres."""
        return self._align_on_points(scan, T_level_sensor, self.config.align_iterations)

    def align_fine(self, scan: Surface, T_level_sensor: NDArray[np.float64]) -> list[Registration]:
        """Aligns on the map's own points until convergence, from (k, 4, 4) aligned poses."""
        return self._align_on_points(scan, T_level_sensor, self.config.fine_iterations)

    def _align_on_points(
        self, scan: Surface, T_level_sensor: NDArray[np.float64], iterations: int
    ) -> list[Registration]:
        found = _align(self.fine, scan, T_level_sensor, iterations, self.config.fine_distance_m, _FINE_ANGLE)
        pairs = _Pairs.of(self.fine, scan, _Placed.at(scan, found.T_level_sensor))
        share = np.abs(pairs.off_m) / self.config.inlier_distance_m
        inlier_ratio = (share <= 1).mean(axis=1)
        alignment_score = np.maximum(1 - share**2, 0).mean(axis=1)
        return [
            Registration(T, float(ratio), float(score), information)
            for T, ratio, score, information in zip(
                found.T_level_sensor, inlier_ratio, alignment_score, found.information, strict=True
            )
        ]


@dataclass(frozen=True)
class _Placed:
    """Scan at k poses, (k, n, 3) each.

    Attributes:
        arms: points relative to the sensor.
        points: in the index's frame.
        normals: in the index's frame.
    """

    arms: NDArray[np.float32]
    points: NDArray[np.float32]
    normals: NDArray[np.float32]

    @classmethod
    def at(cls, scan: Surface, T_level_sensor: NDArray[np.float64]) -> _Placed:
        turn = T_level_sensor[:, :3, :3].astype(np.float32).transpose(0, 2, 1)
        arms = scan.points @ turn
        return cls(arms, arms + T_level_sensor[:, None, :3, 3].astype(np.float32), scan.normals @ turn)


@dataclass(frozen=True)
class _Pairs:
    """Surface points nearest to the points of a placed scan, (k, n, ...).

    Attributes:
        off_m: distance to the surface along its normal; infinite if no surface is near, or only its other
            face.
        normals: of the surface.
        cosine: of the angle between the two normals.
    """

    off_m: NDArray[np.float32]
    normals: NDArray[np.float32]
    cosine: NDArray[np.float32]

    @classmethod
    def of(cls, grid: SurfaceGrid, scan: Surface, placed: _Placed) -> _Pairs:
        points = placed.points - grid.corner
        row = grid.nearest(points.reshape(-1, 3)).reshape(points.shape[:2])
        planes = grid.planes[row]
        normals = planes[..., :3]
        off_m = planes[..., 3] - np.einsum("kni,kni->kn", points, normals)
        cosine = np.einsum("kni,kni->kn", placed.normals, normals)
        other_face = (cosine < _OTHER_FACE) & grid.oriented[row] & scan.oriented
        off_m[(row < 0) | other_face] = np.inf
        return cls(off_m, normals, cosine)


@dataclass(frozen=True)
class _Aligned:
    """Aligned poses, (k, 4, 4), and their information matrices, (k, 6, 6)."""

    T_level_sensor: NDArray[np.float64]
    information: NDArray[np.float64]


def _align(
    grid: SurfaceGrid,
    scan: Surface,
    T_start: NDArray[np.float64],
    iterations: int,
    reach_m: float,
    half_angle: float,
) -> _Aligned:
    """Gauss-Newton over left perturbations: rotation about the sensor, translation along the level axes."""
    T = T_start.copy()
    moving = np.arange(len(T))  # those that have not converged
    hessian = np.zeros((len(T), 6, 6))
    squares, pairs = np.zeros(len(T)), np.ones(len(T))
    for _ in range(iterations):
        placed = _Placed.at(scan, T[moving])
        found = _Pairs.of(grid, scan, placed)
        off_m = found.off_m
        weight = np.maximum(1 - (off_m / np.float32(reach_m)) ** 2, 0) ** 2  # Tukey's; 0 without a surface
        weight /= 1 + np.maximum(1 - found.cosine**2, 0) / np.float32(half_angle**2)
        jacobian = _jacobian(placed.arms, found.normals)  # (k, 6, n)
        weighted = jacobian * weight[:, None]
        off_m[weight == 0] = 0  # infinite ones
        pairs[moving] = weight.sum(axis=1)
        squares[moving] = (weight * off_m**2).sum(axis=1)
        hessian[moving] = weighted @ jacobian.transpose(0, 2, 1)
        gradient = (weighted @ off_m[..., None]).astype(np.float64)
        damped = hessian[moving] + _DAMPING * len(scan) * np.eye(6)
        step = np.linalg.solve(damped, gradient)[..., 0]
        T[moving, :3, :3] = Rotation.from_rotvec(step[:, :3]).as_matrix() @ T[moving, :3, :3]
        T[moving, :3, 3] += step[:, 3:]
        turned, moved = np.abs(step[:, :3]).max(axis=1), np.abs(step[:, 3:]).max(axis=1)
        moving = moving[(turned > _STILL_RAD) | (moved > _STILL_M)]
        if not len(moving):
            break
    variance = squares / np.maximum(pairs, 1) + _NOISE_M**2
    return _Aligned(T, hessian / variance[:, None, None])


def _jacobian(arms: NDArray[np.float32], normals: NDArray[np.float32]) -> NDArray[np.float32]:
    """Jacobian (k, 6, n) of each pair's distance.

    By the rotation about the sensor it is the cross product of arm and normal, by the translation the normal.
    """
    jacobian = np.empty((len(arms), 6, arms.shape[1]), np.float32)
    a, n = arms.transpose(2, 0, 1), normals.transpose(2, 0, 1)
    for axis in range(3):
        after, last = (axis + 1) % 3, (axis + 2) % 3
        jacobian[:, axis] = a[after] * n[last] - a[last] * n[after]
        jacobian[:, 3 + axis] = n[axis]
    return jacobian
