"""From outcomes to the figures of a row."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from firstfix.answer.localization import Verdict

from .outcome import Outcome

SUCCESS_M = (0.05, 0.2, 0.5)
TIGHT_M, TIGHT_DEG = 0.2, 2.0
NEES_MEDIAN = 5.35  # of chi-squared with 6 degrees of freedom: what an honest covariance gives
BINS = 10


def figures_of(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """Returns the figures of a row. A share of nothing is None.

    success_*: share of the map's scans whose best hypothesis is that near, whatever the verdict, with the yaw
    within 5 degrees; ``success_0.2m_2deg``: with the whole rotation within 2.
    distinct_0.2m_2deg: the same for the ``distinct`` scans without a perceptual alias.
    aliases_recognised: of the scans with an alias, the share whose answer was not ``localized`` and had the
    truth among its hypotheses.
    among_all_0.2m: some hypothesis is that near. right_localized: within 0.2 m among ``localized``.
    ece: expected calibration error of the best hypothesis's probability of being right (1 m, 10 degrees).
    nees_median: over right localized answers; NEES_MEDIAN if the covariance is honest.
    """
    inside = [o for o in outcomes if o.inside]
    localized = [o for o in outcomes if o.is_localized]
    nees = [o.nees for o in localized if o.is_right and np.isfinite(o.nees)]
    return {
        "n": len(outcomes),
        "outside": len(outcomes) - len(inside),
        **{f"success_{limit:g}m": _share([o.is_within(limit) for o in inside]) for limit in SUCCESS_M},
        "success_0.2m_2deg": _share([_is_tight(o) for o in inside]),
        "distinct": sum(not o.has_alias for o in inside),
        "distinct_0.2m_2deg": _share([_is_tight(o) for o in inside if not o.has_alias]),
        "aliases_recognised": _share(
            [not o.is_localized and o.nearest_m <= TIGHT_M for o in inside if o.has_alias]
        ),
        "among_all_0.2m": _share([o.nearest_m <= TIGHT_M for o in inside]),
        "verdicts": {v.value: sum(o.verdict is v for o in outcomes) for v in Verdict},
        "right_localized": _share([o.is_within(TIGHT_M) for o in localized if o.inside]),
        "false_accepts": sum(o.is_false_accept for o in outcomes),
        "ece": calibration_error([o.probability for o in outcomes], [o.is_right for o in outcomes]),
        "nees_median": round(float(np.median(nees)), 3) if nees else None,
        "ms": {f"p{q}": round(float(np.percentile([o.ms for o in outcomes], q)), 1) for q in (50, 95, 99)},
    }


def calibration_error(probability: ArrayLike, right: ArrayLike) -> float:
    """Mean over BINS equal bins, weighted by their cases, of how far the claim is from what came true.

    Args:
        probability: (n,) claimed, 0..1.
        right: (n,) whether it came true.
    """
    claimed, true = np.asarray(probability, np.float64), np.asarray(right, np.float64)
    number = np.minimum((claimed * BINS).astype(int), BINS - 1)
    gap = np.bincount(number, claimed - true, minlength=BINS)  # sum in each bin
    return round(float(np.abs(gap).sum() / len(claimed)), 4)


def _is_tight(outcome: Outcome) -> bool:
    return outcome.error_m <= TIGHT_M and outcome.error_deg <= TIGHT_DEG


def _share(flags: Sequence[bool]) -> float | None:
    return round(float(np.mean(flags)), 4) if flags else None
