"""A scan's file as the measuring of sensors takes it: points, beams, and the height above the floor."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from firstfix.engine.config import PreprocessConfig
from firstfix.engine.preprocess import preprocess
from firstfix.formats.point_cloud import PointCloud
from firstfix.scan.levelling import floor_height, turned
from firstfix.scan.scan import MAX_ABS_COORDINATE_M, Scan
from firstfix.scan.sequence import ScanSequence
from firstfix.sensor.measure import MeasuredScan


def sensor_scan(name: str, cloud: PointCloud) -> MeasuredScan:
    """The columns of a scan, to measure its sensor."""
    xyz, ring = cloud.xyz, cloud.ring
    with np.errstate(invalid="ignore"):  # NaN compares false
        usable = (np.abs(xyz) <= MAX_ABS_COORDINATE_M).all(axis=1)
    points = xyz[usable]
    return MeasuredScan(name, points, None if ring is None else ring[usable], _height_m(points))


def _height_m(points: NDArray[np.float64]) -> float | None:
    """Height of the sensor above the floor in the levelled scan, or None if no floor is seen."""
    prepared = preprocess(ScanSequence.single(Scan.from_points(points)), None, PreprocessConfig())
    if prepared is None:
        return None
    (scan,) = prepared.scans
    R, surface = scan.R_level_sensor, scan.thinned
    return floor_height(turned(surface.points, R), turned(surface.normals, R))
