"""Twist: the steady motion of a sensor during its scan.

It has (6,) numbers: m/s along x, y, z, then rad/s about them. The axes are those of the sensor at the scan's
stamp.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidOption

MAX_LINEAR_M_S, MAX_ANGULAR_RAD_S = 100.0, 20.0  # along each axis; the compiled core has the same limits


def checked_twist(numbers: Sequence[float]) -> NDArray[np.float64]:
    """Twist of six numbers.

    Raises:
        InvalidOption: a number is too large.
    """
    twist = np.asarray(numbers, np.float64)
    limits = np.repeat([MAX_LINEAR_M_S, MAX_ANGULAR_RAD_S], 3)
    if not bool((np.abs(twist) <= limits).all()):
        raise InvalidOption(
            f"twist: at most {MAX_LINEAR_M_S:g} m/s and {MAX_ANGULAR_RAD_S:g} rad/s along each axis"
        )
    return twist


def twist_to_mapping(twist: NDArray[np.float64] | None) -> dict[str, list[float]] | None:
    """Values ready for JSON, as in geometry_msgs/Twist."""
    return None if twist is None else {"linear": twist[:3].tolist(), "angular": twist[3:].tolist()}


def twist_from_mapping(data: Mapping[str, Any] | None) -> NDArray[np.float64] | None:
    """Reads what ``twist_to_mapping`` returned."""
    return None if data is None else np.array([*data["linear"], *data["angular"]], np.float64).reshape(6)
