"""Quality of an alignment, and the features from which its probability is computed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import log

import numpy as np
from numpy.typing import NDArray

# Weights of the logarithms in a pose's support: those that most often tell the true place from its rivals in
# ``python -m benchmarks.run calibration`` (docs/method.md section 7), on a scale on which 0.01 of a good
# alignment score is about 0.01 of support.
ALIGNMENT_WEIGHT, REMOVED_WEIGHT, VIOLATION_WEIGHT = 0.25, 0.04, 0.06
BEST_SCORE = 1.05  # the logarithms of perfect values stay finite
LEAST_SHARE = 0.0003
# in the inputs of the probability
_WORST_SCORE, _VIOLATION_OFFSET, _BESIDE_OFFSET, _SAME_OFFSET = 0.02, 0.005, 0.02, 0.02
MAX_MARGIN = 0.25  # about two in three right places have more; more than this counts as this


@dataclass(frozen=True)
class AlignmentQuality:
    """Fit of a scan to the map at one pose.

    Attributes:
        inlier_ratio: 0..1, share of the scan's points within the inlier distance of the map.
        alignment_score: 0..1, the same, but a point counts less the further it lies from the map.
        free_space_violation: 0..1, share of the scan's directions that pass through a surface of the map and
            end where the map has nothing.
        removed_surface: 0..1, share of the scan's directions that pass through a surface of the map and end
            at another one: something may have left.
        beside_surface: 0..1, share of the scan's points that lie near a surface of the map, but on none. It
            speaks against a place more than points where the map has nothing, which a mapping run may have
            missed.
        same_plane: 0..1, chance that two of the scan's upright points that lie on the map lie on one plane.
            It is small where many surfaces agree, and large in a bare room, which has its like elsewhere.
            An answer that was sent has neither of the last two: they are 0.
    """

    inlier_ratio: float
    alignment_score: float
    free_space_violation: float
    removed_surface: float = 0.0
    beside_surface: float = 0.0
    same_plane: float = 0.0

    @cached_property  # each of a hundred poses is compared with all others
    def support(self) -> float:
        """Score by which poses are ranked (equation 7.1). Only differences of it mean something.

        Logarithms of the misfit spread good values: from 98 to 99 % is as far as from 80 to 90 %.
        """
        return -(
            ALIGNMENT_WEIGHT * log(BEST_SCORE - self.alignment_score)
            + REMOVED_WEIGHT * log(LEAST_SHARE + self.removed_surface)
            + VIOLATION_WEIGHT * log(LEAST_SHARE + self.free_space_violation)
        )


@dataclass(frozen=True)
class MatchFeatures:
    """Features of one pose among those that compete, from which its probability is computed.

    If other poses tie with it, they are features of "one of these poses is right".

    Attributes:
        quality: of the pose.
        margin: by how much its support exceeds that of the best pose that does not tie with it.
        tied: number of poses that tie, this one included: no margin tells them apart.
    """

    quality: AlignmentQuality
    margin: float
    tied: int = 1

    @property
    def vector(self) -> NDArray[np.float64]:
        """(5,) inputs of the logistic model (equation 7.2). A larger value never lowers the probability.

        A removed surface does not count here, but in the margin: things leave, wherever the scan was taken.
        """
        score, violation = self.quality.alignment_score, self.quality.free_space_violation
        return np.array(
            [
                log((_WORST_SCORE + score) / (BEST_SCORE - score)),
                -log(_VIOLATION_OFFSET + violation),
                -log(_BESIDE_OFFSET + self.quality.beside_surface),
                -log(_SAME_OFFSET + self.quality.same_plane),
                min(self.margin, MAX_MARGIN),
            ]
        )


def match_features(
    qualities: Sequence[AlignmentQuality], tied_within: float, number: int = 0
) -> MatchFeatures:
    """Match features of one pose, given the qualities of all poses that compete.

    If several poses compete and all of them tie, the best rival was not compared. Then the margin is what is
    known of it: the lead of the pose over the weakest one.

    Args:
        tied_within: poses tie if their support differs by less.
        number: of the pose.
    """
    supports = [quality.support for quality in qualities]
    own = supports[number]
    rivals = [support for support in supports if abs(support - own) >= tied_within]
    margin = MAX_MARGIN if len(supports) == 1 else own - (max(rivals) if rivals else min(supports))
    return MatchFeatures(qualities[number], margin, len(supports) - len(rivals))
