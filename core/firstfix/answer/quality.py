"""Quality of an alignment, and the features from which its probability is computed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FREE_SPACE_WEIGHT = 2.0  # of free_space_violation against alignment_score, when poses are ranked
MAX_FREE_SPACE_VIOLATION = 0.2  # more than this counts as this
MAX_MARGIN = 0.5


@dataclass(frozen=True)
class AlignmentQuality:
    """Fit of a scan to the map at one pose.

    Attributes:
        inlier_ratio: 0..1, share of the scan's points within the inlier distance of the map.
        alignment_score: 0..1, the same, but a point counts less the further it lies from the map.
        free_space_violation: 0..1, share of the scan's directions that pass through a surface of the map.
    """

    inlier_ratio: float
    alignment_score: float
    free_space_violation: float

    @property
    def support(self) -> float:
        """Score by which poses are ranked: alignment score less a penalty for free-space violation."""
        return self.alignment_score - FREE_SPACE_WEIGHT * min(
            self.free_space_violation, MAX_FREE_SPACE_VIOLATION
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
        """(3,) inputs of the logistic model (equation 7.1). A larger value never lowers the probability.

        Logarithms of the misfit spread good values: from 98 to 99 % is as far as from 80 to 90 %.
        """
        return np.array(
            [
                -np.log(1.05 - self.quality.alignment_score),
                -np.log(0.005 + min(self.quality.free_space_violation, MAX_FREE_SPACE_VIOLATION)),
                min(self.margin, MAX_MARGIN),
            ]
        )


def match_features(
    qualities: Sequence[AlignmentQuality], tied_within: float, number: int = 0
) -> MatchFeatures:
    """Match features of one pose, given the qualities of all poses that compete.

    Args:
        tied_within: poses tie if their support differs by less.
        number: of the pose.
    """
    own = qualities[number].support
    rivals = [quality.support for quality in qualities if abs(quality.support - own) >= tied_within]
    margin = own - max(rivals) if rivals else MAX_MARGIN
    return MatchFeatures(qualities[number], margin, len(qualities) - len(rivals))
