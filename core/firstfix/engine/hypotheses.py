"""From candidates to the distinct places where the scan settles."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from ..answer.prior import Prior
from ..answer.quality import AlignmentQuality, MatchFeatures
from ..transform import pose_error
from .calibration import Calibration
from .candidates import Candidate
from .index import MapIndex
from .preprocess import PreparedQuery
from .registration.align import Registration

SAME_PLACE_M = 1.0
SAME_PLACE_DEG = 15.0
RIVAL_WITHIN = 0.15  # of the best place's support
REFINED = 3  # places at most
ASTRAY_M = 0.3  # a place's neighbouring minima lie about so far off: the next panel, a wall's other face
BETTER = 0.02  # by so much alignment_score: a scan distorted by the robot's motion has several nearly as good
PROMISING = 0.02  # probability before the last refinement, which adds a little to the inlier ratio


@dataclass(frozen=True)
class Place:
    """A template's row, where the scan settled from it, and how it lies there.

    ``free_space_violation`` is 0 until the place is looked at.
    """

    template: int
    registration: Registration
    free_space_violation: float = 0.0

    @property
    def quality(self) -> AlignmentQuality:
        return AlignmentQuality(
            self.registration.inlier_ratio, self.registration.alignment_score, self.free_space_violation
        )

    def is_same_as(self, other: Place) -> bool:
        distance_m, angle_deg = pose_error(
            self.registration.T_level_sensor, other.registration.T_level_sensor
        )
        return distance_m < SAME_PLACE_M and angle_deg < SAME_PLACE_DEG


def find_places(
    index: MapIndex, prepared: PreparedQuery, candidates: Sequence[Candidate], prior: Prior | None = None
) -> list[Place]:
    """Distinct places that the prior allows, the best first; only that one and its close rivals are
    registered finely, and only where one may yet be accepted."""

    def settled() -> list[Place]:
        starts = np.array([candidate.T_level_sensor for candidate in candidates])
        found = index.surface.settle(prepared.sparse, index.surface.approach(prepared.sparse, starts))
        return [Place(c.template, registration) for c, registration in zip(candidates, found, strict=True)]

    def around(place: Place) -> Place:
        """The place, or a minimum beside it that is clearly better."""
        starts = np.repeat(place.registration.T_level_sensor[None], 9, axis=0)
        starts[:, :2, 3] += ASTRAY_M * np.array(list(product((0, -1, 1), repeat=2)))
        found = index.surface.settle(prepared.sparse, starts)
        best = max(found, key=lambda registration: registration.alignment_score)
        return Place(
            place.template, best if best.alignment_score > found[0].alignment_score + BETTER else found[0]
        )

    def refined(places: Sequence[Place]) -> list[Place]:
        starts = np.array([around(place).registration.T_level_sensor for place in places])
        found = index.surface.refine(prepared.dense, starts)
        return [Place(place.template, fine) for place, fine in zip(places, found, strict=True)]

    def looked_at(place: Place) -> Place:
        T_level_last = place.registration.T_level_sensor
        each = [
            index.view.free_space_violation(scan.view, T_level_last @ scan.T_last_scan)
            for scan in prepared.scans
        ]
        return replace(place, free_space_violation=sum(each) / len(each))

    def ranked(places: Iterable[Place]) -> list[Place]:
        allowed = (
            place
            for place in places
            if prior is None or prior.allows(index.T_map_level @ place.registration.T_level_sensor)
        )
        return _distinct(sorted(allowed, key=lambda place: -place.quality.support))

    if not candidates:
        return []
    places = ranked(_contenders(ranked(settled()), looked_at, index.config.verification.compared))
    if not places or not _promising(index.calibration, places):
        return places
    # a rival that is not much worse may only have settled worse: it gets the same chance
    near = [place for place in places if place.quality.support > places[0].quality.support - RIVAL_WITHIN][
        :REFINED
    ]
    return ranked([*map(looked_at, refined(near)), *places[len(near) :]])


def _contenders(settled: Sequence[Place], look_at: Callable[[Place], Place], at_most: int) -> list[Place]:
    """Those that may be the best, or its best rival: looking can only lessen support."""
    looked: list[Place] = []
    for place in settled[:at_most]:
        supports = sorted((known.quality.support for known in looked), reverse=True)
        if len(supports) > 1 and place.quality.support < min(supports[1], supports[0] - RIVAL_WITHIN):
            break
        looked.append(look_at(place))
    return looked


def place_evidence(calibration: Calibration, places: Sequence[Place]) -> MatchFeatures:
    """MatchFeatures for the first of ranked places, and for those that tie with it."""
    return calibration.match_features([place.quality for place in places])


def _promising(calibration: Calibration, places: list[Place]) -> bool:
    """Whether the best may be accepted yet. Before the self-test has measured anything all may."""
    return not calibration.cases or calibration.probability(place_evidence(calibration, places)) >= PROMISING


def _distinct(places: Iterable[Place]) -> list[Place]:
    """The first of every place, in order."""
    kept: list[Place] = []
    for place in places:
        if not any(place.is_same_as(known) for known in kept):
            kept.append(place)
    return kept
