"""From candidates to the distinct places where the scan settles."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from .calibration import Calibration
from .candidates import Candidate
from .evidence import Fit, evidence
from .map_index import MapIndex
from .preprocess import PreparedQuery
from .prior import Prior
from .registration import Registration
from .transform import Matrix, pose_error

SAME_PLACE_M = 1.0
SAME_PLACE_DEG = 15.0
RIVAL_WITHIN = 0.15  # of the best place's support
REFINED = 3  # places at most
STARTS = 2  # of the best place: VGICP leaves a motion-distorted scan in one of several minima
APART_M = 0.15
PROMISING = 0.02  # probability before the last refinement, which adds a little overlap
CONFIRMATIONS = 2  # candidates that settled at one spot: a further start beside it tells nothing new
BESIDE_M = 2.0


@dataclass(frozen=True)
class Place:
    """A template's row, where the scan settled from it, and how it lies there.

    ``seen_through`` is 0 until the place is looked at.
    """

    template: int
    registration: Registration
    seen_through: float = 0.0

    @property
    def fit(self) -> Fit:
        return Fit(self.registration.overlap, self.registration.closeness, self.seen_through)

    def is_same_as(self, other: Place) -> bool:
        return _same(self.registration.T_level_sensor, other.registration.T_level_sensor)


def find_places(
    index: MapIndex, prepared: PreparedQuery, candidates: Iterable[Candidate], prior: Prior | None = None
) -> list[Place]:
    """Distinct places that the prior allows, the best first; only that one and its close rivals are
    registered finely, and only where one may yet be accepted."""

    def compared_at(place: Place) -> Place:
        T_level_sensor = place.registration.T_level_sensor
        return looked_at(Place(place.template, index.cloud.compare(prepared.sparse, T_level_sensor)))

    def refined(place: Place) -> Place:
        T_level_sensor = place.registration.T_level_sensor
        return Place(place.template, index.cloud.refine(prepared.dense, T_level_sensor))

    def looked_at(place: Place) -> Place:
        T_level_last = place.registration.T_level_sensor
        each = [
            index.view.seen_through(scan.returns, T_level_last @ scan.T_last_scan) for scan in prepared.scans
        ]
        return replace(place, seen_through=sum(each) / len(each))

    def allowed(place: Place) -> bool:
        return prior is None or prior.allows(index.T_map_level @ place.registration.T_level_sensor)

    settled: list[Place] = []
    for candidate in candidates:
        if not _is_settled_around(candidate.T_level_sensor, settled):
            registration = index.cloud.settle(prepared.sparse, candidate.T_level_sensor)
            settled.append(Place(candidate.template, registration))
    settled = sorted(filter(allowed, settled), key=_support)
    compared = [compared_at(place) for place in _distinct(settled)[: index.config.verification.compared]]
    places = _distinct(sorted(filter(allowed, compared), key=_support))
    if not places or not _promising(index.calibration, places):
        return places
    # a rival that is not much worse may only have settled worse: it gets the same chance
    near = [place for place in places if place.fit.support > places[0].fit.support - RIVAL_WITHIN][:REFINED]
    finest = [looked_at(max(map(refined, _starts(places[0], settled)), key=_fineness))]
    finest += [looked_at(refined(rival)) for rival in near[1:]]
    return _distinct(sorted(filter(allowed, [*finest, *places[len(near) :]]), key=_support))


def _promising(calibration: Calibration, places: list[Place]) -> bool:
    """Whether the best may be accepted yet. Before the self-test has measured anything all may."""
    return not calibration.cases or calibration.probability(evidence([p.fit for p in places])) >= PROMISING


def _starts(place: Place, settled: Iterable[Place]) -> list[Place]:
    """Where its fine registration begins: from itself, and from where else candidates settled in it."""
    return _apart([place, *(other for other in settled if other.is_same_as(place))])[:STARTS]


def _support(place: Place) -> float:
    """Sorts the best supported first."""
    return -place.fit.support


def _fineness(place: Place) -> float:
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
