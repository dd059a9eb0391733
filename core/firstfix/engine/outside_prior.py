"""Is a prior wrong? Where the best place in it has aliases outside, the scan is compared with these, too.

Those that are as good do not count: which of them is right, the prior says. One that is clearly better shows
that the prior is wrong: the scan was taken there. Most places have no alias, and a prior saves the search of
the whole map.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..answer.prior import Prior
from .candidates import Candidates
from .hypotheses import HypothesisSearch
from .known_aliases import known_aliases
from .registered_candidate import RegisteredCandidate


def aliases_outside(best: RegisteredCandidate, prior: Prior, hypotheses: HypothesisSearch) -> Candidates:
    """The known aliases of a pose that a prior excludes, if the scan may fit them as well.

    Args:
        best: the pose, in the prior.
        hypotheses: of the scan.
    """
    index, placed = best.index, best.registration
    found = known_aliases(index, placed.T_level_sensor, None)
    is_outside = ~prior.allows_each(index.T_map_level @ found.T_level_sensor)
    found = found.at(np.flatnonzero(is_outside))
    return hypotheses.not_far_behind(found, placed.T_level_sensor, placed.twist)


def lead_outside(found: Sequence[RegisteredCandidate], best: RegisteredCandidate, prior: Prior) -> float:
    """Support by which the best of the found poses outside a prior is better than the one in it, or 0."""
    outside = [one.support for one in found if not prior.allows(one.T_map_sensor)]
    return max(0.0, max(outside) - best.support) if outside else 0.0
