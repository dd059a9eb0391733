"""From candidates to the distinct places where the scan settles."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from small_gicp import PointCloud

from .calibration import Calibration
from .candidates import Candidate
from .preprocess import PreparedScan
from .registration import MapCloud, Registration
from .transform import Matrix, pose_error

SAME_PLACE_M = 1.0
SAME_PLACE_DEG = 15.0
COMPARED = 3  # places that are registered finely: the best, and rivals for the margin
COMPARED_ITERATIONS = 6  # are enough to compare them
STARTS = 2  # of the best place: VGICP leaves a motion-distorted scan in one of several minima
APART_M = 0.15
PROMISING = 0.02  # probability before the last refinement, which adds a little overlap
CONFIRMATIONS = 2  # candidates that settled at one spot: a further start beside it tells nothing new
BESIDE_M = 2.0


@dataclass(frozen=True)
class Place:
    """A template's row, and where the scan settled from it."""

    template: int
    registration: Registration

    def is_same_as(self, other: Place) -> bool:
        return _same(self.registration.T_level_sensor, other.registration.T_level_sensor)


def find_places(
    cloud: MapCloud, prepared: PreparedScan, candidates: Iterable[Candidate], calibration: Calibration
) -> list[Place]:
    """Distinct places, the best first; only that one is registered with all the points.

    Args:
        calibration: says whether the best place may yet be accepted; if not, it is left unrefined.
    """
    settled: list[Place] = []
    for candidate in candidates:
        if not _is_settled_around(candidate.T_level_sensor, settled):
            settled.append(Place(candidate.template, cloud.settle(prepared.sparse, candidate.T_level_sensor)))
    settled.sort(key=_closeness)
    compared = [
        _refined(cloud, prepared.sparse, place, COMPARED_ITERATIONS)
        for place in _distinct(settled)[:COMPARED]
    ]
    places = _distinct(sorted(compared, key=_closeness))
    overlaps = [place.registration.overlap for place in places]
    if places and calibration.probability(overlaps[0], margin(overlaps)) >= PROMISING:
        starts = _apart([places[0], *(place for place in settled if place.is_same_as(places[0]))])[:STARTS]
        places[0] = max((_refined(cloud, prepared.dense, start, None) for start in starts), key=_fit)
    return places


def margin(overlaps: list[float]) -> float:
    """By how much the first overlap exceeds the best of the others."""
    return overlaps[0] - max(overlaps[1:], default=0.0)


def _refined(cloud: MapCloud, scan: PointCloud, place: Place, iterations: int | None) -> Place:
    return Place(place.template, cloud.refine(scan, place.registration.T_level_sensor, iterations))


def _closeness(place: Place) -> float:
    """Sorts the closest fit first."""
    return -place.registration.closeness


def _fit(place: Place) -> float:
    """Tells two minima of one place apart: their closeness alone may tie."""
    return place.registration.closeness + place.registration.overlap


def _distinct(places: Iterable[Place]) -> list[Place]:
    """The first of every place, in order."""
    kept: list[Place] = []
    for place in places:
        if not any(place.is_same_as(known) for known in kept):
            kept.append(place)
    return kept


def _apart(places: Iterable[Place]) -> list[Place]:
    """The first of every spot APART_M from the ones before: starts that may lead to another minimum."""
    kept: list[Place] = []
    for place in places:
        here = place.registration.T_level_sensor[:3, 3]
        if all(np.linalg.norm(here - known.registration.T_level_sensor[:3, 3]) > APART_M for known in kept):
            kept.append(place)
    return kept


def _is_settled_around(T_level_sensor: Matrix, settled: list[Place]) -> bool:
    """Whether enough candidates have settled at one place near this start."""
    near = [
        known.registration.T_level_sensor
        for known in settled
        if np.linalg.norm(known.registration.T_level_sensor[:3, 3] - T_level_sensor[:3, 3]) < BESIDE_M
    ]
    return any(sum(_same(a, b) for b in near) > CONFIRMATIONS for a in near)


def _same(T_a: Matrix, T_b: Matrix) -> bool:
    distance_m, angle_deg = pose_error(T_a, T_b)
    return distance_m < SAME_PLACE_M and angle_deg < SAME_PLACE_DEG
