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
    """Attributes:
    margin: by how much its support exceeds that of the best other place.
    """

    fit: Fit
    margin: float

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


def evidence(fits: Sequence[Fit], place: int = 0) -> Evidence:
    """For one of the places that the scan was compared at, given all of them."""
    rivals = [fit.support for number, fit in enumerate(fits) if number != place]
    return Evidence(fits[place], fits[place].support - max(rivals) if rivals else MOST_MARGIN)
