"""Directions in which an answered pose is hardly fixed: along a corridor, over an open field."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Any

import numpy as np
from numpy.typing import NDArray


class Motion(str, Enum):
    """Kind of a free direction: the pose may shift along it, or turn about it."""

    TRANSLATION = "translation"
    ROTATION = "rotation"


@dataclass(frozen=True)
class FreeDirection:
    """A direction in which the scan leaves the pose free.

    Attributes:
        motion: shift along the direction, or turn about it.
        direction: (3,) unit vector in the map frame. Its sign says nothing: the largest part is positive.
        sigma: standard deviation of the pose in this direction: metres of a shift, radians of a turn.
    """

    motion: Motion
    direction: NDArray[np.float64]
    sigma: float

    def to_mapping(self) -> dict[str, Any]:
        """Values ready for JSON."""
        return {"motion": self.motion.value, "direction": self.direction.tolist(), "sigma": self.sigma}

    @classmethod
    def from_mapping(cls, data: Mapping[str, Any]) -> FreeDirection:
        """Read what ``to_mapping`` returned. Unknown keys are ignored."""
        direction = np.array(data["direction"], np.float64).reshape(3)
        return cls(Motion(data["motion"]), direction, float(data["sigma"]))
