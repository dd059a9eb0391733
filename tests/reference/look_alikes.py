"""Which look-alikes a scan tells from the best place, in NumPy: ``native`` is held against it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from firstfix.answer.prior import Prior
from firstfix.answer.quality import AlignmentQuality
from firstfix.engine.ranking import RankingConfig
from firstfix.engine.registered_candidate import RegisteredCandidate
from tests.reference.known_aliases import is_any_of, is_stacked
from tests.reference.template_places import known_aliases

# lab/docs/experiments.md, "Which leads over a look-alike can be trusted"
_LEADS_BY = 0.08  # of support: less is what things that move may give to a look-alike
_AGREES = 0.4  # inlier ratio below which not even the walls agree
_EXPLAINED = 0.7  # alignment score from which on the map has most of what the scan shows
_CLEARLY = 0.02  # of support, by which a place is contradicted more than the best one, or less
_ONE_THING = 0.05  # of the alignment score: a person at 2 m covers four in a hundred points


def with_look_alikes_marked(
    registered: Sequence[RegisteredCandidate], prior: Prior | None
) -> list[RegisteredCandidate]:
    """The candidates of one map, best first, with those marked that the scan does not tell from the best.

    These are known aliases near the best one's support, and rivals right above or below that the map may
    lack. A scan in motion fits wrong places well, as each has three unknowns more: there all rivals are
    marked that the map may lack.
    """
    best, index = registered[0], registered[0].index
    ranking = index.config.ranking
    T_level_sensor = np.array([one.registration.T_level_sensor for one in registered])
    lead = best.support - np.array([one.support for one in registered])
    lacking = np.array(
        [may_lack(ranking, one.registration.alignment_score, one.quality, best.quality) for one in registered]
    )
    is_small = np.array([is_one_thing(ranking, one.quality, best.quality) for one in registered])
    aliases, at_m = known_aliases(index, T_level_sensor[0], prior).T_level_sensor, T_level_sensor[:, :3, 3]
    is_known = is_any_of(aliases, T_level_sensor, ranking)
    is_alike = is_known & (np.abs(lead) < index.calibration.alias_margin)
    is_alike &= ~are_parted(lead, lacking | is_small, at_m)
    doubted = lacking & (lead < ranking.rival_within)
    is_alike |= doubted if best.registration.is_in_motion else doubted & is_stacked(at_m[0], at_m)
    is_alike[0] = False
    return [replace(one, is_alike=alike) for one, alike in zip(registered, is_alike.tolist(), strict=True)]


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
