"""Simulates realistic scans: with noise, dropout, passers-by, tilt and other sensor heights."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from firstfix.builds.config import PerturbConfig
from firstfix.scan.levelling import turned
from firstfix.scan.scan import Scan
from firstfix.sensor import SensorModel
from firstfix.transform import Matrix, make_transform, rotation_z

from .boxes import Boxes
from .changed_world import Sight, changed_ranges
from .moving import Motion, moving_ranges
from .rays import KEPT, Rays
from .simulate import Simulator

_CLEARANCE_M = 0.3
_PLACES_ELSEWHERE, _ELSEWHERE_M = 12, 3.0
_TRIES = 20  # for each spot that is not free


@dataclass(frozen=True)
class _Occluder:
    """Distance, width and top of one kind of obstacle; the top is measured from the sensor."""

    away_m: tuple[float, float]
    width_m: tuple[float, float]
    top_m: float


_PERSON = _Occluder((1.0, 6.0), (0.3, 1.0), 0.6)
_STRANGER = _Occluder((3.0, 15.0), (1.0, 4.0), 1.0)


@dataclass(frozen=True)
class ScanCase:
    """Pose and perturbations of a scan to simulate.

    Attributes:
        T_level_sensor: (4, 4).
        seed: of all other perturbations.
        elsewhere_m: (k, 3) sensor positions at other places, whose views stand for unmapped surfaces.
    """

    T_level_sensor: Matrix
    seed: int
    elsewhere_m: NDArray[np.float64]


@dataclass(frozen=True)
class ScanSimulation:
    """Simulation of perturbed scans of one sensor in one map. Thread-safe."""

    simulator: Simulator
    sensor: SensorModel
    config: PerturbConfig

    def cases(
        self, around_m: NDArray[np.floating], reach_m: float, count: int, rng: np.random.Generator
    ) -> list[ScanCase]:
        """Choose free spots within half of ``reach_m`` of the given places along x and y, any heading.

        Nothing stands between a spot and its place, because a place behind a wall may not be in the map.

        Args:
            around_m: (n, 3) sensor positions.

        Returns:
            At most ``count`` cases: fewer where free spots are rare.
        """
        found: list[ScanCase] = []
        for _ in range(_TRIES):
            missing = count - len(found)
            if not missing:
                break
            start = around_m[rng.integers(len(around_m), size=missing)].astype(np.float64)
            at = start.copy()
            at[:, :2] += rng.uniform(-reach_m / 2, reach_m / 2, (missing, 2))
            at[:, 2] += rng.normal(0, self.config.height_m, missing)
            free = self.simulator.is_free(at, _CLEARANCE_M) & self.simulator.is_way_free(start, at)
            for spot in at[free]:
                R = _tilted(rng, self.config.tilt_deg) @ self.sensor.R_base_sensor
                seed = int(rng.integers(2**63))
                found.append(ScanCase(make_transform(R, spot), seed, _elsewhere(around_m, spot, seed)))
        return found

    def clean_ranges(self, case: ScanCase) -> NDArray[np.float32]:
        """(n,) ranges of a case's rays in the world as it was mapped: all disturbances begin with them."""
        rays = Rays.of_scan(self.sensor, self._moment(np.random.default_rng(case.seed)))
        return next(self.simulator.ranges(case.T_level_sensor[None], self.sensor, rays))[0]

    def scan(
        self,
        case: ScanCase,
        motion: Motion | None = None,
        *,
        clean: NDArray[np.float32] | None = None,
    ) -> Scan:
        """Simulate the scan of a case.

        With a motion during it, its points have times, and the world is as it was mapped.

        Args:
            clean: ``clean_ranges`` of the case, if they are there already.
        """
        rng, config = np.random.default_rng(case.seed), self.config
        moment = self._moment(rng)
        rays, time_s = Rays.of_scan(self.sensor, moment), None
        if motion is None:
            ranges = self._ranges(case, rays, self.clean_ranges(case) if clean is None else clean)
        else:
            time_s = motion.sweep.times(rays.directions)
            ranges = moving_ranges(self.simulator, self.sensor, case.T_level_sensor, motion, rays)
        ranges += config.noise_m * rng.standard_normal(len(ranges), np.float32)
        lost = rng.random(len(ranges), np.float32) < config.dropout
        severity = rng.uniform(0, 2)  # from a quiet night to a rush hour
        around = _Panorama.of(self.sensor, moment)
        around.occlude(ranges, rng.poisson(config.occluders * severity), _PERSON, rng)
        around.occlude(ranges, rng.poisson(config.strangers * severity), _STRANGER, rng)
        seen = np.isfinite(ranges) & ~lost
        taken_s = None if time_s is None else time_s[seen]
        return Scan.from_points(rays.directions[seen] * ranges[seen, None], time_s=taken_s)

    def _moment(self, rng: np.random.Generator) -> int:
        return int(rng.integers(self.sensor.moments)) if self.sensor.moments > 1 else 0

    def _ranges(self, case: ScanCase, rays: Rays, clean: NDArray[np.float32]) -> NDArray[np.float32]:
        """(n,) ranges without noise in the changed world."""
        config = self.config
        if not config.unmapped and not config.vanished:
            return clean.copy()
        sight = Sight(case.T_level_sensor, rays.turned(case.T_level_sensor), clean)
        changes = np.random.default_rng((case.seed, 1))
        return changed_ranges(self.simulator, self.sensor, sight, case.elsewhere_m, config, changes)


def perturbed_scans(
    simulator: Simulator,
    sensor: SensorModel,
    around_m: NDArray[np.floating],
    reach_m: float,
    count: int,
    config: PerturbConfig,
    rng: np.random.Generator,
) -> list[tuple[Scan, Matrix]]:
    """Pairs of scan and T_level_sensor for all ``ScanSimulation.cases``."""
    simulation = ScanSimulation(simulator, sensor, config)
    cases = simulation.cases(around_m, reach_m, count, rng)
    return [(simulation.scan(case), case.T_level_sensor) for case in cases]


def _elsewhere(around_m: NDArray[np.floating], spot_m: NDArray[np.float64], seed: int) -> NDArray[np.float64]:
    """Some of (n, 3) positions that are not at the spot."""
    some = around_m[np.random.default_rng((seed, 2)).integers(len(around_m), size=_PLACES_ELSEWHERE)]
    return some[np.linalg.norm(some - spot_m, axis=1) > _ELSEWHERE_M].astype(np.float64)


def _tilted(rng: np.random.Generator, tilt_deg: float) -> NDArray[np.float64]:
    roll, pitch = np.radians(rng.normal(0, tilt_deg, 2))
    about_x = np.array([[1, 0, 0], [0, np.cos(roll), -np.sin(roll)], [0, np.sin(roll), np.cos(roll)]])
    about_y = np.array([[np.cos(pitch), 0, np.sin(pitch)], [0, 1, 0], [-np.sin(pitch), 0, np.cos(pitch)]])
    return rotation_z(rng.uniform(-np.pi, np.pi)) @ about_y @ about_x


@dataclass(frozen=True)
class _Panorama:
    """The rays of an upright robot's sensor, sorted by azimuth.

    Attributes:
        row: (n,) of each ray in the sensor's order.
        azimuth: (n,) ascending, radians.
        rise: (n,) z of the unit rays.
    """

    row: NDArray[np.intp]
    azimuth: NDArray[np.float32]
    rise: NDArray[np.float32]

    @staticmethod
    def of(sensor: SensorModel, moment: int) -> _Panorama:
        return _panorama(sensor, moment)

    def occlude(
        self, ranges: NDArray[np.float32], count: int, kind: _Occluder, rng: np.random.Generator
    ) -> None:
        """Add obstacles between the sensor and the map, which stop the rays through them."""
        for _ in range(count):
            away, width = rng.uniform(*kind.away_m), rng.uniform(*kind.width_m)
            middle, half = rng.uniform(-np.pi, np.pi), width / away / 2
            for turn in (-2 * np.pi, 0.0, 2 * np.pi):  # an obstacle may stand where the azimuth jumps
                ends = (middle - half + turn, middle + half + turn)
                here = slice(*np.searchsorted(self.azimuth, ends))
                row = self.row[here][self.rise[here] * away < kind.top_m]
                ranges[row] = np.minimum(ranges[row], np.float32(away))


@lru_cache(KEPT)
def _panorama(sensor: SensorModel, moment: int) -> _Panorama:
    x, y, z = turned(Rays.of_scan(sensor, moment).directions, sensor.R_base_sensor).T
    azimuth = np.arctan2(y, x)
    row = np.argsort(azimuth, kind="stable")
    return _Panorama(row, azimuth[row], z[row])


def elsewhere(rng: np.random.Generator) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Vertices (n, 3) and triangles (m, 3) of a place outside all maps: a yard with random boxes."""
    sizes, centres, yaws = [np.array([80.0, 80.0, 0.2])], [np.array([0.0, 0.0, -0.1])], [0.0]
    for _ in range(40):
        centre = rng.uniform(-30, 30, 2)
        size = rng.uniform(0.5, 8, 3)
        sizes.append(size)
        centres.append(np.array([*centre, size[2] / 2]))
        yaws.append(rng.uniform(0, np.pi))
    return Boxes(np.array(centres), np.array(sizes) / 2, np.array(yaws)).mesh()
