"""The result of a SLAM run in a place: a trajectory with a little drift, and the cloud that fits it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from firstfix.sensor import SensorModel
from firstfix.transform import rotation_z
from firstfix_builder.simulation.rays import Rays
from firstfix_builder.simulation.simulate import Simulator

RAYS_PER_SCAN = 12_000  # of a mapping scan; the voxel grid would swallow more
DROPOUT = 0.05
DRIFT_M = 0.02  # in each of x and y; half of it in z
DRIFT_YAW_DEG = 0.02  # 2 cm at 60 m
DRIFT_PERIOD_M = 120.0
SCANS_AT_ONCE = 64


@dataclass(frozen=True)
class Survey:
    """A mapping run and its map.

    Attributes:
        T_world_sensor: (m, 4, 4) where the robot was.
        T_map_sensor: (m, 4, 4) where its SLAM says it was: the map's frame.
        cloud: (n, 3) float64 merged scans, in the map's frame.
    """

    T_world_sensor: NDArray[np.float64]
    T_map_sensor: NDArray[np.float64]
    cloud: NDArray[np.float64]


def survey(
    simulator: Simulator,
    sensor: SensorModel,
    T_world_sensor: NDArray[np.float64],
    voxel_m: float,
    rng: np.random.Generator,
) -> Survey:
    """Scan at every pose of the drive, laid out where the drifting estimate puts them."""
    T_map_sensor = drifted(T_world_sensor, rng)
    coarse = sensor.coarser(RAYS_PER_SCAN)
    sums = VoxelSums(voxel_m)
    for start in range(0, len(T_world_sensor), SCANS_AT_ONCE):
        chunk = slice(start, start + SCANS_AT_ONCE)
        laid = [
            measure(ranges, coarse, rng) @ T[:3, :3].T + T[:3, 3]
            for block in simulator.ranges(T_world_sensor[chunk], coarse)
            for ranges, T in zip(block, T_map_sensor[chunk], strict=True)
        ]
        sums.add(np.concatenate(laid))
    return Survey(T_world_sensor, T_map_sensor, sums.means())


def measure(
    ranges: NDArray[np.float32], sensor: SensorModel, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Clean ranges (rays,) to noisy points (n, 3) in the sensor frame, a share of them lost."""
    noisy = ranges + rng.normal(0, sensor.range_noise_m, len(ranges))
    heard = np.isfinite(ranges) & (rng.uniform(size=len(ranges)) > DROPOUT)
    points: NDArray[np.float64] = noisy[heard, None] * Rays.of_sensor(sensor).directions[heard]
    return points


def drifted(T_world_sensor: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float64]:
    """The (m, 4, 4) poses with an error that wanders slowly along the way, at most DRIFT_M on each axis."""
    steps = np.linalg.norm(np.diff(T_world_sensor[:, :3, 3], axis=0), axis=1)
    phase = 2 * np.pi * np.concatenate([[0.0], np.cumsum(steps)]) / DRIFT_PERIOD_M
    # two incommensurable waves an axis, so that a place met again is met with another error
    shift = rng.uniform(0, 2 * np.pi, (2, 4))
    waves = 0.6 * np.sin(phase[:, None] + shift[0]) + 0.4 * np.sin(1.9 * phase[:, None] + shift[1])
    drift = waves * [DRIFT_M, DRIFT_M, DRIFT_M / 2, np.radians(DRIFT_YAW_DEG)]  # (m, 4)
    T = T_world_sensor.copy()
    T[:, :3, :3] = np.stack([rotation_z(yaw) for yaw in drift[:, 3]]) @ T[:, :3, :3]
    T[:, :3, 3] += drift[:, :3]
    return T


class VoxelSums:
    """The mean point of every voxel of a cloud too large to hold: points come in portions."""

    REACH = 1 << 20  # cells to either side of the origin along each axis

    def __init__(self, voxel_m: float) -> None:
        self.voxel_m = voxel_m
        self._keys: list[NDArray[np.int64]] = []
        self._sums: list[NDArray[np.float64]] = []  # x, y, z, count

    def add(self, points: NDArray[np.float64]) -> None:
        """Add (n, 3) points."""
        cell = np.floor(points / self.voxel_m).astype(np.int64) + self.REACH
        key = (cell[:, 0] * (2 * self.REACH) + cell[:, 1]) * (2 * self.REACH) + cell[:, 2]
        self._keep(key, np.column_stack([points, np.ones(len(points))]))

    def means(self) -> NDArray[np.float64]:
        """(n, 3) one point a voxel, ordered by voxel."""
        keys, sums = np.concatenate(self._keys), np.concatenate(self._sums)
        self._keys, self._sums = [], []
        self._keep(keys, sums)
        total = self._sums[0]
        return total[:, :3] / total[:, 3:]

    def _keep(self, keys: NDArray[np.int64], sums: NDArray[np.float64]) -> None:
        order = np.argsort(keys, kind="stable")
        keys, sums = keys[order], sums[order]
        first = np.concatenate([[True], keys[1:] != keys[:-1]])
        self._keys.append(keys[first])
        self._sums.append(np.add.reduceat(sums, np.flatnonzero(first), axis=0))
