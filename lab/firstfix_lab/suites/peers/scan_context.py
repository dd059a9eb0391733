"""Scan Context over the mapping scans (Kim and Kim, IROS 2018), then firstfix's registration.

The plain method: maximum height over 20 rings and 60 sectors, a KD tree over ring keys, all column
shifts of the nearest ten, one place: the numbers of its section IV, with the sensor's range where it is below
80 m. The scans of the mapping run stand where the robot drove; a data set without them has the map's points
round its mapping poses. The method takes the sensor to stand upright, so all scans are levelled: it has the
true direction of gravity. Its confidence is 1 minus the distance. Distances up to 0.15 are accepted: its
authors recommend 0.1 to 0.15 (irapkaist/SC-LeGO-LOAM, issue 1).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from firstfix.builds.config import BuildConfig
from firstfix.engine.index import MapIndex
from firstfix.engine.preprocess import preprocess
from firstfix.scan.levelling import levelling_rotation
from firstfix.scan.scan import Scan
from firstfix.scan.sequence import ScanSequence
from firstfix.transform import Matrix, inverse, make_transform, rotation_z, transform_points

from .answer import Answer
from .peer_input import PeerInput
from .prior import Prior
from .sent import points_bytes

RINGS, SECTORS, MAX_RANGE_M = 20, 60, 80.0
CANDIDATES = 10
MAX_DISTANCE = 0.15


class ScanContextPeer:
    sent_bytes = staticmethod(points_bytes)

    def __init__(self, given: PeerInput) -> None:
        self._given = given
        sensor = BuildConfig.parse(given.dataset.config).sensor_model
        self._range_m, self._height_m = min(MAX_RANGE_M, sensor.max_range_m), sensor.mount_height_m
        contexts, self._T_map_level = [], []
        for points, T_map_mapping in given.mapping_clouds(self._range_m):
            T_level_mapping = _levelling(-T_map_mapping[2, :3])
            contexts.append(self._describe(transform_points(T_level_mapping, points)))
            self._T_map_level.append(T_map_mapping @ inverse(T_level_mapping))
        self._contexts = np.array(contexts)  # (m, 20, 60)
        self._keys = cKDTree(ring_key(self._contexts))
        self._index = MapIndex.load(given.version)

    def __call__(self, scan: Scan, prior: Prior) -> Answer:
        T_level_sensor = _levelling(prior.gravity)
        context = self._describe(transform_points(T_level_sensor, self._given.cropped(scan)))
        near = self._keys.query(ring_key(context), min(CANDIDATES, len(self._contexts)))[1]
        distance, yaw_rad = np.array([match(context, self._contexts[row]) for row in near]).T
        best = int(np.argmin(distance))
        turn = make_transform(rotation_z(yaw_rad[best]), np.zeros(3))
        T_map_sensor = self._register(scan, self._T_map_level[near[best]] @ turn @ T_level_sensor)
        return Answer(T_map_sensor, 1 - distance[best], distance[best] <= MAX_DISTANCE)

    def _describe(self, points: NDArray[np.floating]) -> NDArray[np.float64]:
        return scan_context(points, self._range_m, self._height_m)

    def _register(self, scan: Scan, T_map_sensor: Matrix) -> Matrix | None:
        prepared = preprocess(ScanSequence.single(scan), None, self._index.config.preprocess)
        if prepared is None:
            return None
        surface, T_map_level = self._index.surface, self._index.T_map_level
        near, _ = surface.align_coarse(prepared.sparse, (inverse(T_map_level) @ T_map_sensor)[None])
        (settled,) = surface.align(prepared.sparse, near)
        (fine,) = surface.align_fine(prepared.dense, settled.T_level_sensor[None])
        return T_map_level @ fine.T_level_sensor


def scan_context(points: NDArray[np.floating], range_m: float, height_m: float) -> NDArray[np.float64]:
    """(n, 3) points in an upright sensor frame to (20, 60) maximum heights above the floor, 0 where empty."""
    away_m = np.hypot(points[:, 0], points[:, 1])
    azimuth = np.arctan2(points[:, 1], points[:, 0]) % (2 * np.pi)
    ring = np.floor(away_m / range_m * RINGS).astype(int)
    sector = np.minimum((azimuth / (2 * np.pi) * SECTORS).astype(int), SECTORS - 1)
    context = np.zeros((RINGS, SECTORS))
    inside = ring < RINGS
    np.maximum.at(context, (ring[inside], sector[inside]), points[inside, 2] + height_m)
    return context


def ring_key(context: NDArray[np.float64]) -> NDArray[np.float64]:
    """(..., 20, 60) contexts to (..., 20) shares of sectors that are not empty."""
    return np.mean(context > 0, axis=-1)


def match(query: NDArray[np.float64], known: NDArray[np.float64]) -> tuple[float, float]:
    """Least mean cosine distance of the columns over all shifts, and the query's yaw there in radians."""
    a, b = _unit_columns(query), _unit_columns(known)
    shifted = np.stack([np.roll(a, shift, axis=1) for shift in range(SECTORS)])  # (60, 20, 60)
    filled = shifted.any(axis=1) & b.any(axis=0)  # (60, 60)
    similar = np.einsum("krs,rs->ks", shifted, b)
    distance = 1 - similar.sum(axis=1) / np.maximum(filled.sum(axis=1), 1)
    best = int(np.argmin(distance))
    return float(distance[best]), best * 2 * np.pi / SECTORS


def _levelling(gravity: NDArray[np.float64]) -> Matrix:
    return make_transform(levelling_rotation(-gravity), np.zeros(3))


def _unit_columns(context: NDArray[np.float64]) -> NDArray[np.float64]:
    return context / np.maximum(np.linalg.norm(context, axis=0), 1e-9)
