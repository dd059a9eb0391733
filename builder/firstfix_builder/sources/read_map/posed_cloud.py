"""A map's points with the poses of its mapping run, as they are read, for a provisional version."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from firstfix.transform import Matrix

from .held_out import HeldOut


@dataclass(frozen=True)
class PosedCloud:
    """Points and poses in the level frame, checked for all that refuses a map, and not cleaned.

    Attributes:
        points: (n, 3) finite metres.
        trajectory: (m, 4, 4) T_level_sensor of the mapping run, at least one.
        spacing_m: between neighbouring points.
        T_map_level: (4, 4) to the coordinates of the source.
        findings: of the map, as JSON values: all that hold a version back are among them.
        held_out: scans of the source that are not among the points, with poses in the level frame.
    """

    points: NDArray[np.float64]
    trajectory: NDArray[np.float64]
    spacing_m: float
    T_map_level: Matrix
    findings: Sequence[Mapping[str, Any]]
    held_out: HeldOut


OnPosedCloud: TypeAlias = Callable[[PosedCloud], None]
