"""What speaks for a place: how well the scan lies on the map there, and how much better than elsewhere."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

THROUGH_WEIGHT = 2.0  # of seeing through against closeness, when places are ranked
MOST_THROUGH = 0.2  # more than this is no worse
MOST_MARGIN = 0.5


@dataclass(frozen=True)
class Fit:
    """How a scan lies on the map at one pose.

    Attributes:
        overlap: 0..1, share of its points within the inlier distance of the map.
        closeness: 0..1, the same but each point counts less the further off it lies.
        seen_through: 0..1, share of its directions that pass through what the map says is there.
    """

    overlap: float
    closeness: float
    seen_through: float

    @property
    def support(self) -> float:
        """By this places are ranked."""
        return self.closeness - THROUGH_WEIGHT * min(self.seen_through, MOST_THROUGH)


@dataclass(frozen=True)
class Evidence:
    """Evidence for the best place; where others tie with it, for one of all these being right.

    Attributes:
        fit: of the best place.
        margin: by how much its support exceeds that of the best place that does not tie with it.
        tied: how many places tie, the best one included: no margin tells them apart.
    """

    fit: Fit
    margin: float
    tied: int = 1

    @property
    def features(self) -> NDArray[np.float64]:
        """(3,) what probability is a function of; more of any speaks for the place.

        Logarithms of the shares that do not fit: between 98 and 99 % lies as much as between 80 and 90.
        """
        return np.array(
            [
                -np.log(1.05 - self.fit.closeness),
                -np.log(0.005 + min(self.fit.seen_through, MOST_THROUGH)),
                min(self.margin, MOST_MARGIN),
            ]
        )


def evidence(fits: Sequence[Fit], tied_within: float, place: int = 0) -> Evidence:
    """For one of the places that the scan was compared at, given all of them.

    Args:
        tied_within: places tie whose support differs by less.
    """
    own = fits[place].support
    rivals = [fit.support for fit in fits if abs(fit.support - own) >= tied_within]
    margin = own - max(rivals) if rivals else MOST_MARGIN
    return Evidence(fits[place], margin, len(fits) - len(rivals))
