"""What speaks for a place: how well the scan lies on the map there, and how much better than elsewhere."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FREE_SPACE_WEIGHT = 2.0  # of seeing through against alignment_score, when places are ranked
MAX_FREE_SPACE_VIOLATION = 0.2  # more than this is no worse
MAX_MARGIN = 0.5


@dataclass(frozen=True)
class AlignmentQuality:
    """How a scan lies on the map at one pose.

    Attributes:
        inlier_ratio: 0..1, share of its points within the inlier distance of the map.
        alignment_score: 0..1, the same but each point counts less the further off it lies.
        free_space_violation: 0..1, share of its directions that pass through what the map says is there.
    """

    inlier_ratio: float
    alignment_score: float
    free_space_violation: float

    @property
    def support(self) -> float:
        """By this places are ranked."""
        return self.alignment_score - FREE_SPACE_WEIGHT * min(
            self.free_space_violation, MAX_FREE_SPACE_VIOLATION
        )


@dataclass(frozen=True)
class MatchFeatures:
    """Evidence for the best place; where others tie with it, for one of all these being right.

    Attributes:
        quality: of the best place.
        margin: by how much its support exceeds that of the best place that does not tie with it.
        tied: how many places tie, the best one included: no margin tells them apart.
    """

    quality: AlignmentQuality
    margin: float
    tied: int = 1

    @property
    def features(self) -> NDArray[np.float64]:
        """(3,) what probability is a function of; more of any speaks for the place.

        Logarithms of the shares that do not fit: between 98 and 99 % lies as much as between 80 and 90.
        """
        return np.array(
            [
                -np.log(1.05 - self.quality.alignment_score),
                -np.log(0.005 + min(self.quality.free_space_violation, MAX_FREE_SPACE_VIOLATION)),
                min(self.margin, MAX_MARGIN),
            ]
        )


def match_features(
    qualities: Sequence[AlignmentQuality], tied_within: float, place: int = 0
) -> MatchFeatures:
    """For one of the places that the scan was compared at, given all of them.

    Args:
        tied_within: places tie whose support differs by less.
    """
    own = qualities[place].support
    rivals = [quality.support for quality in qualities if abs(quality.support - own) >= tied_within]
    margin = own - max(rivals) if rivals else MAX_MARGIN
    return MatchFeatures(qualities[place], margin, len(qualities) - len(rivals))
