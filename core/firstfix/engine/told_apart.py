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
_ONE_THING = 0.05  # of the alignment score: a person at 2 m covers four in a hundred points


def are_parted(
    lead: NDArray[np.float64], is_doubtful: NDArray[np.bool_], at_m: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """(k,) which of k places, the best one first, a scan tells from the best.

    Rooms above each other are never told apart: one plan is furnished twice, and furniture moves.

    Args:
        lead: (k,) of the best one's support over theirs.
        is_doubtful: (k,) by ``may_lack`` or ``is_one_thing``.
        at_m: (k, 3) of the sensor, in the level frame.
    """
    found: NDArray[np.bool_] = (lead >= _LEADS_BY) & ~is_doubtful & ~is_stacked(at_m[0], at_m)
    return found


def is_one_thing(ranking: RankingConfig, place: AlignmentQuality, best: AlignmentQuality) -> bool:
    """Whether one thing that moved may give the best place its lead over another.

    Where both explain nearly all of the scan, support spreads what a person hides to a clear lead.
    """
    by = ranking.contradiction(place) - ranking.contradiction(best)
    return best.alignment_score - place.alignment_score < _ONE_THING and by < _CLEARLY


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
