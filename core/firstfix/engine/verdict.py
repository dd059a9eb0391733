"""The verdict: from the compiled decision to an answer, or to the reason why there is none.

The decision is compiled: ``native/include/firstfix/query/verdict.hpp`` and ``answered.hpp``.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..answer.free_direction import FreeDirection, Motion
from ..answer.localization import Hypothesis, Localization, Reason, Verdict
from ..answer.options import LocalizeOptions
from ..answer.quality import AlignmentQuality
from ..errors import InvalidOption
from .index import MapIndex

_MOTION = Motion.TRANSLATION, Motion.ROTATION


def answer_of(
    reason: str | None,
    probability: float,
    places: Sequence[tuple[Any, ...]],
    placed: tuple[Any, ...] | None,
    map_ids: Sequence[str],
    twist: NDArray[np.float64] | None,
) -> Localization:
    """Answer of one map or several.

    Args:
        reason: code of the reason why there is no pose; None: there is one.
        places: best first, like ``placed`` as ``native.answered`` gives them.
        placed: what is known of the pose.
        map_ids: of the searches.
        twist: (6,) of the caller; None: not known.
    """
    found = []
    for search, template, T_map_sensor, fit, share in places:
        quality = AlignmentQuality(*fit)
        found.append(Hypothesis(T_map_sensor, quality, share, template, map_ids[search]))
    hypotheses = tuple(found)
    if placed is None:
        why = Reason(reason)
        verdict = Verdict.AMBIGUOUS if why is Reason.SEVERAL_PLACES else Verdict.REJECTED
        return Localization(verdict, (why,), probability=probability, hypotheses=hypotheses)
    T_map_base, covariance, free, solved = placed
    return Localization(
        Verdict.LOCALIZED,
        T_map_sensor=hypotheses[0].T_map_sensor,
        T_map_base=T_map_base,
        covariance=covariance,
        probability=probability,
        hypotheses=hypotheses,
        map_id=hypotheses[0].map_id,
        twist=solved if twist is None else twist,
        degenerate=tuple(map(_free_direction, free)),
    )


def _free_direction(axis: tuple[bool, NDArray[np.float64], float]) -> FreeDirection:
    is_turn, direction, sigma = axis
    return FreeDirection(Motion.ROTATION if is_turn else Motion.TRANSLATION, direction, sigma)


def threshold_of(index: MapIndex, options: LocalizeOptions, map_id: str = "") -> float | None:
    """Threshold on the probability that the caller asks of a map; None: the map's own.

    Raises:
        InvalidOption: two thresholds are asked for, or no threshold of this map promises what is asked.
    """
    if options.max_false_accept is None:
        return options.min_probability
    if options.min_probability is not None:
        raise InvalidOption("min_probability and max_false_accept both set the threshold: give one")
    return index.false_accept_bound.min_probability(options.max_false_accept, map_id)
