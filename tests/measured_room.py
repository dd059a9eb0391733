"""Scans of a sensor in a room, cast without a simulator: four walls, a floor and a ceiling."""

import numpy as np

from firstfix.sensor import SensorModel

LOW_M, HIGH_M = np.array([-9.0, -6.5, 0.0]), np.array([11.0, 7.5, 4.5])


def room_scan(sensor: SensorModel, seed: int, noise_m: float = 0.01, lost: float = 0.05, moment: int = 0):
    """(n, 3) points of one scan in the sensor frame, beam by beam, and the (n,) numbers of their rays."""
    rng = np.random.default_rng(seed)
    rays = sensor.scan_directions(moment).astype(np.float64)
    at = np.array([0.4, -0.3, sensor.mount_height_m])
    with np.errstate(divide="ignore"):
        walls_m = np.where(rays > 0, (HIGH_M - at) / rays, (LOW_M - at) / rays)
    range_m = np.abs(walls_m).min(axis=1) + rng.normal(0, noise_m, len(rays))
    seen = (rng.random(len(rays)) >= lost) & (range_m > sensor.min_range_m)
    return (rays * range_m[:, None])[seen].astype(np.float32), np.flatnonzero(seen)
