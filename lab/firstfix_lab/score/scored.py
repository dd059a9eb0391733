"""One case and what a system answered, as the metrics see it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..evaluation.outcome import FALSE_DEG, FALSE_M


@dataclass(frozen=True)
class Scored:
    """One case.

    Attributes:
        is_inside: True if the scan was taken in the map.
        error_m: distance of the best pose from the true one; inf without either.
        error_deg: angle of the rotation between them; inf without either.
        has_pose: True if the system gave a pose, accepted or not.
        is_accepted: True if the system vouches for its pose.
        confidence: 0..1, the system's own, that its pose is right; None: it gives none.
        time_s: from the scan to the answer; None: not said.
    """

    is_inside: bool
    error_m: float = np.inf
    error_deg: float = np.inf
    has_pose: bool = False
    is_accepted: bool = False
    confidence: float | None = None
    time_s: float | None = None

    def is_within(self, limit_m: float, limit_deg: float) -> bool:
        """True if the best pose is this close to the true one, accepted or not."""
        return self.error_m <= limit_m and self.error_deg <= limit_deg

    @property
    def is_right(self) -> bool:
        """True if the best pose is the place: within 1 m and 10 degrees."""
        return self.is_within(FALSE_M, FALSE_DEG)

    @property
    def is_false_accept(self) -> bool:
        """True if the system vouches for a pose that is not the place."""
        return self.is_accepted and not self.is_right
