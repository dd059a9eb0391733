"""Which look-alikes a scan tells from the best place (docs/method.md section 7).

The rules are compiled: ``native/include/firstfix/query/look_alikes.hpp``.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .. import native
from ..answer.quality import AlignmentQuality
from .ranking import RankingConfig


def told_apart(
    ranking: RankingConfig, fits: Sequence[AlignmentQuality], T_level_sensor: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """(k,) which of k places, the best one first, a scan tells from the best.

    Args:
        fits: (k,) of the scan to the places.
        T_level_sensor: (k, 4, 4) the places.
    """
    best = fits[0]
    support = np.array([ranking.support(fit) for fit in fits])
    is_doubtful = [
        native.may_lack(ranking, fit.alignment_score, fit, best) or native.is_one_thing(ranking, fit, best)
        for fit in fits
    ]
    at_m = np.ascontiguousarray(T_level_sensor[:, :3, 3])
    return native.are_parted(support[0] - support, np.array(is_doubtful), at_m)
