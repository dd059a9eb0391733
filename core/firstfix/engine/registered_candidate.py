"""A candidate after registration, and how such candidates are compared."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from ..answer.quality import AlignmentQuality, MatchFeatures
from ..transform import Matrix, pose_error
from .index import MapIndex
from .registration.align import Registration

SAME_POSE_M = 1.0
SAME_POSE_DEG = 15.0


@dataclass(frozen=True)
class RegisteredCandidate:
    """A pose in one map to which a candidate was aligned.

    Attributes:
        index: the map.
        map_id: its id, where several maps compete.
        template: row of the template that the candidate came from.
        registration: the aligned pose, and how well the scan fits there.
        free_space_violation: 0..1; 0 until free space is checked.
    """

    index: MapIndex
    map_id: str
    template: int
    registration: Registration
    free_space_violation: float = 0.0

    @property
    def quality(self) -> AlignmentQuality:
        """Fit of the scan to the map at this pose."""
        return AlignmentQuality(
            self.registration.inlier_ratio, self.registration.alignment_score, self.free_space_violation
        )

    @property
    def T_map_sensor(self) -> Matrix:
        """(4, 4) pose in the map's own frame."""
        return self.index.T_map_level @ self.registration.T_level_sensor

    def has_pose_of(self, other: RegisteredCandidate) -> bool:
        """Returns whether both are nearly the same pose. They must be of the same map."""
        distance_m, angle_deg = pose_error(
            self.registration.T_level_sensor, other.registration.T_level_sensor
        )
        return distance_m < SAME_POSE_M and angle_deg < SAME_POSE_DEG


def ranked(candidates: Iterable[RegisteredCandidate]) -> list[RegisteredCandidate]:
    """Candidates of one map by support, best first; of nearly the same pose only the best is kept."""
    kept: list[RegisteredCandidate] = []
    for candidate in sorted(candidates, key=lambda candidate: -candidate.quality.support):
        if not any(candidate.has_pose_of(better) for better in kept):
            kept.append(candidate)
    return kept


def features_of(ranked: Sequence[RegisteredCandidate], number: int = 0) -> MatchFeatures:
    """Match features of one of the ranked candidates, for the calibration of its own map."""
    calibration = ranked[number].index.calibration
    return calibration.match_features([candidate.quality for candidate in ranked], number)
