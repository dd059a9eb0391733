"""From outcomes to the figures of a row."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from firstfix.answer.localization import Verdict
from firstfix.engine.false_accept_bound import upper_bound

from .outcome import Outcome, Standing

SUCCESS_M = (0.05, 0.2, 0.5)
TIGHT_M, TIGHT_DEG = 0.2, 2.0
NEES_MEDIAN = 5.35  # of chi-squared with 6 degrees of freedom: what an honest covariance gives
BINS = 10
LOOK_ALIKES = "outside: look-alikes"


def figures_of(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """The figures of a row. A share of nothing is None.

    success_*: share of the map's scans whose best hypothesis is that near, whatever the verdict, with the yaw
    within 5 degrees; ``success_0.2m_2deg``: with the whole rotation within 2.
    distinct_0.2m_2deg: the same for the ``distinct`` scans without a perceptual alias.
    aliases_recognised: of the scans with an alias, the share whose answer was not ``localized`` and had the
    truth among its hypotheses.
    among_all_0.2m: some hypothesis is within 0.2 m.
    first: the best hypothesis is the place (1 m, 10 degrees).
    right_localized: within 0.2 m among ``localized``.
    wrong_0.2m: answers ``localized`` that are off by over 0.2 m, false accepts among them.
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
        "aliases_recognised": _share([_is_recognised(o) for o in inside if o.has_alias]),
        "among_all_0.2m": _share([o.nearest_m <= TIGHT_M for o in inside]),
        "first": _share([o.is_right for o in inside]),
        "verdicts": {v.value: sum(o.verdict is v for o in outcomes) for v in Verdict},
        "right_localized": _share([o.is_within(TIGHT_M) for o in localized if o.inside]),
        "false_accepts": sum(o.is_false_accept for o in outcomes),
        "wrong_0.2m": sum(o.is_wrong for o in outcomes),
        "ece": _calibration(outcomes),
        "nees_median": round(float(np.median(nees)), 3) if nees else None,
        "ms": {f"p{q}": round(float(np.percentile([o.ms for o in outcomes], q)), 1) for q in (50, 95, 99)},
    }


def bars_of(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """Figures by which the suite is judged. A share of nothing is None.

    first: of the ``distinct`` scans of the map, the best hypothesis is the place (1 m, 10 degrees).
    within_0.2m_2deg: it is so near. localized: it is the place, and the answer is ``localized``.
    found: some hypothesis is within 0.2 m.
    aliases: scans that another place explains as well. outshone: scans that another place explains better.
    aliases_recognised, outshone_recognised: of these, the share whose answer was not ``localized`` and had
    the truth among its hypotheses.
    false_accepts: of all ``answers``, inside and outside.
    false_accepts_at_most: upper end of their share (``upper_bound``).
    wrong_0.2m: of all ``answers``, those ``localized`` over 0.2 m off, false accepts among them.
    ece, look_alikes_ece: of all answers, and of scans of places outside that are built alike.
    """
    inside = [o for o in outcomes if o.inside]
    distinct = [o for o in inside if o.standing is Standing.DISTINCT]
    aliases = [o for o in inside if o.standing is Standing.ALIAS]
    outshone = [o for o in inside if o.standing is Standing.OUTSHONE]
    false_accepts = sum(o.is_false_accept for o in outcomes)
    return {
        "answers": len(outcomes),
        "distinct": len(distinct),
        "found": _share([o.nearest_m <= TIGHT_M for o in distinct]),
        "first": _share([o.is_right for o in distinct]),
        "within_0.2m_2deg": _share([_is_tight(o) for o in distinct]),
        "localized": _share([o.is_right and o.is_localized for o in distinct]),
        "aliases": len(aliases),
        "aliases_recognised": _share([_is_recognised(o) for o in aliases]),
        "outshone": len(outshone),
        "outshone_recognised": _share([_is_recognised(o) for o in outshone]),
        "false_accepts": false_accepts,
        "false_accepts_at_most": upper_bound(false_accepts, len(outcomes)),
        "wrong_0.2m": sum(o.is_wrong for o in outcomes),
        "ece": _calibration(outcomes),
        "look_alikes_ece": _calibration([o for o in outcomes if o.case == LOOK_ALIKES]),
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


def _calibration(outcomes: Sequence[Outcome]) -> float | None:
    if not outcomes:
        return None
    return calibration_error([o.probability for o in outcomes], [o.is_right for o in outcomes])


def _is_tight(outcome: Outcome) -> bool:
    return outcome.error_m <= TIGHT_M and outcome.error_deg <= TIGHT_DEG


def _is_recognised(outcome: Outcome) -> bool:
    """The answer is not ``localized``, and the truth is among its hypotheses."""
    return not outcome.is_localized and outcome.nearest_m <= TIGHT_M


def _share(flags: Sequence[bool]) -> float | None:
    return round(float(np.mean(flags)), 4) if flags else None
