"""Scans as a robot's would be, not as the simulator's are: noise, dropout, passers-by, tilt, height."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from firstfix.builds.config import PerturbConfig
from firstfix.scan.levelling import turned
from firstfix.scan.scan import Scan
from firstfix.sensor import SensorModel
from firstfix.transform import Matrix, make_transform, rotation_z

from .simulate import Simulator

_CLEARANCE_M = 0.3


@dataclass(frozen=True)
class _Occluder:
    """Distance, width and top of one kind of obstacle; the top is measured from the sensor."""

    away_m: tuple[float, float]
    width_m: tuple[float, float]
    top_m: float


_PERSON = _Occluder((1.0, 6.0), (0.3, 1.0), 0.6)
_STRANGER = _Occluder((3.0, 15.0), (1.0, 4.0), 1.0)


def perturbed_scans(
    simulator: Simulator,
    sensor: SensorModel,
    around_m: NDArray[np.floating],
    reach_m: float,
    count: int,
    config: PerturbConfig,
    rng: np.random.Generator,
) -> list[tuple[Scan, Matrix]]:
    """Scans at free spots within half of ``reach_m`` of the given places, any heading.

    Args:
        around_m: (n, 3) sensor positions.

    Returns:
        At most ``count`` pairs of scan and T_level_sensor: fewer where free spots are rare.
    """
    scans: list[tuple[Scan, Matrix]] = []
    directions, R_base_sensor = sensor.directions(), sensor.R_base_sensor
    upright = turned(directions, R_base_sensor)
    for _ in range(20 * count):
        if len(scans) == count:
            break
        at = np.array(around_m[rng.integers(len(around_m))], np.float64)
        at[:2] += rng.uniform(-reach_m / 2, reach_m / 2, 2)
        at[2] += rng.normal(0, config.height_m)
        if simulator.distance(at[None])[0] < _CLEARANCE_M:
            continue
        T = make_transform(_tilted(rng, config.tilt_deg) @ R_base_sensor, at)
        ranges = next(simulator.ranges(T[None], sensor))[0]
        ranges = ranges + rng.normal(0, config.noise_m, ranges.shape).astype(np.float32)
        ranges[rng.random(ranges.shape) < config.dropout] = np.inf
        severity = rng.uniform(0, 2)  # a quiet night, a rush hour: real overlaps vary as widely
        _occlude(ranges, upright, rng.poisson(config.occluders * severity), _PERSON, rng)
        _occlude(ranges, upright, rng.poisson(config.strangers * severity), _STRANGER, rng)
        seen = np.isfinite(ranges)
        scans.append((Scan.from_points(directions[seen] * ranges[seen, None]), T))
    return scans


def _tilted(rng: np.random.Generator, tilt_deg: float) -> NDArray[np.float64]:
    roll, pitch = np.radians(rng.normal(0, tilt_deg, 2))
    about_x = np.array([[1, 0, 0], [0, np.cos(roll), -np.sin(roll)], [0, np.sin(roll), np.cos(roll)]])
    about_y = np.array([[np.cos(pitch), 0, np.sin(pitch)], [0, 1, 0], [-np.sin(pitch), 0, np.cos(pitch)]])
    return rotation_z(rng.uniform(-np.pi, np.pi)) @ about_y @ about_x


def _occlude(
    ranges: NDArray[np.float32],
    directions: NDArray[np.float32],
    count: int,
    kind: _Occluder,
    rng: np.random.Generator,
) -> None:
    """Things that stand between the sensor and the map stop the rays that would pass through them."""
    azimuth = np.arctan2(directions[:, 1], directions[:, 0])
    for _ in range(count):
        away, width = rng.uniform(*kind.away_m), rng.uniform(*kind.width_m)
        off = np.abs((azimuth - rng.uniform(-np.pi, np.pi) + np.pi) % (2 * np.pi) - np.pi)
        stopped = (off < width / away / 2) & (directions[:, 2] * away < kind.top_m) & (ranges > away)
        ranges[stopped] = away


def elsewhere(rng: np.random.Generator) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Vertices and triangles of a place that is in nobody's map: a yard of random boxes."""
    boxes = [(np.array([0.0, 0.0, -0.1]), np.array([80.0, 80.0, 0.2]), 0.0)]
    for _ in range(40):
        centre = rng.uniform(-30, 30, 2)
        size = rng.uniform(0.5, 8, 3)
        boxes.append((np.array([*centre, size[2] / 2]), size, rng.uniform(0, np.pi)))
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])
    vertices = [(corners * size) @ rotation_z(yaw).T + centre for centre, size, yaw in boxes]
    triangles = [faces + 8 * i for i in range(len(boxes))]
    return np.concatenate(vertices), np.concatenate(triangles)
