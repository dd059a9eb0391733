"""Known aliases: where the sensor would stand in places that look alike (docs/method.md section 7.1).

The search is compiled: ``native/include/firstfix/query/template_places.hpp``.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from .. import native
from ..transform import Matrix
from .candidates import Candidates
from .index import MapIndex
from .ranking import CandidatesConfig


def known_aliases(index: MapIndex, T_level_sensor: Matrix) -> Candidates:
    """Poses right above and below a pose, then at aliases of the templates nearest to it, most alike first.

    None without a table.

    Args:
        index: of the map.
        T_level_sensor: (4, 4) the pose.
    """
    return Candidates(*index.searched.known_aliases(T_level_sensor, None))


def is_any_of(
    aliases: NDArray[np.float64], T_level_sensor: NDArray[np.float64], ranking: CandidatesConfig
) -> NDArray[np.bool_]:
    """(n,) which of (n, 4, 4) poses are nearly the same as one of (k, 4, 4) aliases."""
    within_rad = math.radians(ranking.same_pose_deg)
    return native.is_any_of(T_level_sensor, aliases, ranking.same_pose_m, within_rad)
