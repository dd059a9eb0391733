"""Held-out scans made worse: fewer rings, fewer points, blind sectors, a tilted mount. Pure NumPy."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from firstfix.scan.scan import Scan
from firstfix.sensor import SensorModel
from firstfix.transform import Matrix, inverse, make_transform

SECTOR_DEG = (10.0, 40.0)
LLOYD_ROUNDS = 20


def every_second_ring(scan: Scan, sensor: SensorModel) -> Scan:
    """The points of every second beam."""
    return _kept(scan, ring_of(scan.points, sensor) % 2 == 0)


def part_of_points(scan: Scan, share: float, rng: np.random.Generator) -> Scan:
    """``share`` (0..1) of the points, drawn at random."""
    drawn = np.zeros(len(scan), bool)
    drawn[rng.permutation(len(scan))[: round(share * len(scan))]] = True
    return _kept(scan, drawn)


def without_sectors(scan: Scan, share: float, rng: np.random.Generator) -> Scan:
    """The scan with random sectors, each SECTOR_DEG wide, blind: ``share`` (0..1) of the points is gone."""
    azimuth_deg = np.degrees(np.arctan2(scan.points[:, 1], scan.points[:, 0]))
    blind = np.zeros(len(scan), bool)
    wanted = round(share * len(scan))
    while blind.sum() < wanted:
        off_deg = (azimuth_deg - rng.uniform(-180, 180)) % 360  # from where the sector begins
        inside = np.flatnonzero((off_deg < rng.uniform(*SECTOR_DEG)) & ~blind)
        nearest = inside[np.argsort(off_deg[inside])]
        blind[nearest[: wanted - blind.sum()]] = True
    return _kept(scan, ~blind)


def within(scan: Scan, reach_m: float) -> Scan:
    """The scan without what is farther from the sensor."""
    return _kept(scan, np.linalg.norm(scan.points, axis=1) <= reach_m)


def tilted(
    scan: Scan, T_map_sensor: Matrix, tilt_deg: float, rng: np.random.Generator
) -> tuple[Scan, Matrix]:
    """The scan as a sensor rolled and pitched by ``tilt_deg`` each, either way, sees it; and its pose."""
    roll, pitch = np.radians(tilt_deg) * rng.choice([-1, 1], 2)
    about_x = [[1, 0, 0], [0, np.cos(roll), -np.sin(roll)], [0, np.sin(roll), np.cos(roll)]]
    about_y = [[np.cos(pitch), 0, np.sin(pitch)], [0, 1, 0], [-np.sin(pitch), 0, np.cos(pitch)]]
    T_sensor_tilted = make_transform(np.array(about_y) @ np.array(about_x), np.zeros(3))
    T_tilted_sensor = inverse(T_sensor_tilted)
    points = (scan.points @ T_tilted_sensor[:3, :3].T).astype(np.float32)
    return Scan(points, scan.intensity, scan.stamp_s), T_map_sensor @ T_sensor_tilted


def ring_of(points: NDArray[np.floating], sensor: SensorModel) -> NDArray[np.intp]:
    """(n, 3) points in the sensor frame to the (n,) number of the ring that each belongs to.

    KITTI's files hold one ring after the other, which shows in the azimuth; its lasers do not sit in
    one point, so that elevation would mix them. Else the rings are clusters of the elevation.
    """
    in_order = _ring_by_order(points)
    beams = len(sensor.elevations_deg)
    if in_order[-1] + 1 == beams:
        return in_order
    return _ring_by_elevation(points, np.sort(np.asarray(sensor.elevations_deg)))


def _ring_by_order(points: NDArray[np.floating]) -> NDArray[np.intp]:
    """(n,) how often the azimuth has gone full circle."""
    azimuth = np.arctan2(points[:, 1], points[:, 0]) % (2 * np.pi)
    return np.concatenate([[0], np.cumsum(np.abs(np.diff(azimuth)) > np.pi)])


def _ring_by_elevation(points: NDArray[np.floating], nominal_deg: NDArray[np.floating]) -> NDArray[np.intp]:
    """Lloyd's algorithm in one dimension, from the nominal beams (b,) in ascending order."""
    elevation_deg = np.degrees(np.arctan2(points[:, 2], np.hypot(points[:, 0], points[:, 1])))
    centre_deg = np.array(nominal_deg, np.float64)
    for _ in range(LLOYD_ROUNDS):
        ring = np.searchsorted((centre_deg[1:] + centre_deg[:-1]) / 2, elevation_deg)
        count = np.bincount(ring, minlength=len(centre_deg))
        total = np.bincount(ring, elevation_deg, minlength=len(centre_deg))
        centre_deg = np.where(count > 0, total / np.maximum(count, 1), centre_deg)
    return ring


def _kept(scan: Scan, keep: NDArray[np.bool_]) -> Scan:
    intensity = None if scan.intensity is None else scan.intensity[keep]
    return Scan(scan.points[keep], intensity, scan.stamp_s)
