"""Which look-alikes a scan tells from the best place (docs/method.md section 7).

A map may lack most of a room: the mapping run only passed its door. A scan of it fits a look-alike far better
that is mapped well, as most of its points meet nothing where they belong. But they contradict nothing there
either. A room that is mapped, and another one, has surfaces that the scan sees through.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..answer.quality import AlignmentQuality
from .ranking import RankingConfig
from .stacked_places import is_stacked

# lab/docs/experiments.md, "Which leads over a look-alike can be trusted"
_LEADS_BY = 0.08  # of support: less is what things that move may give to a look-alike
_AGREES = 0.4  # inlier ratio below which not even the walls agree
_EXPLAINED = 0.7  # alignment score from which on the map has most of what the scan shows
_CLEARLY = 0.02  # of support, by which a place is contradicted more than the best one, or less


def are_parted(
    lead: NDArray[np.float64], may_be_missing: NDArray[np.bool_], at_m: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """(k,) which of k places, the best one first, a scan tells from the best.

    Rooms above each other are never told apart: one plan is furnished twice, and furniture moves.

    Args:
        lead: (k,) of the best one's support over theirs.
        may_be_missing: (k,) by ``may_lack``.
        at_m: (k, 3) of the sensor, in the level frame.
    """
    found: NDArray[np.bool_] = (lead >= _LEADS_BY) & ~may_be_missing & ~is_stacked(at_m[0], at_m)
    return found


def may_lack(
    ranking: RankingConfig, alignment_score: float, place: AlignmentQuality, best: AlignmentQuality
) -> bool:
    """Whether a place may fit worse than the best one only because the map lacks much of it.

    The scan contradicts it clearly less than the best one, or not more where much meets nothing.

    Args:
        alignment_score: at the place, however unlikely the motion.
        place: its quality, where that counts.
    """
    if place.inlier_ratio < _AGREES:
        return False
    by = ranking.contradiction(place) - ranking.contradiction(best)
    return by < -_CLEARLY or (by < _CLEARLY and alignment_score < _EXPLAINED)
