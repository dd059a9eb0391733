"""The decision of the verdict in Python: ``native.decided`` is held against it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from math import exp

from firstfix.answer.localization import Reason
from firstfix.answer.options import LocalizeOptions
from firstfix.engine.calibration import Calibration
from firstfix.engine.ranking import MatchFeatures
from firstfix.engine.registered_candidate import RegisteredCandidate
from firstfix.engine.verdict import threshold_of

# Probability that a scan in motion needs, at least and at most. Below the first, two of 3,420 were localized
# wrongly; no moving scan of another office reached the second (lab/docs/experiments.md, "Robots in motion
# among look-alikes").
_IN_MOTION = (0.997, 0.999)
# Of support, to each side of the lead from which a place no longer ties. Points rounded to a centimetre move
# leads by about half of it: a place that is just within would add .16 to the probability, and then not.
BLUR = 0.01
# Of support: a place that is so far behind leads e times less often in another encoding of the scan.
_ROUNDING = 0.02
MEASURED_FINELY = 3  # best places whose agreement is measured with many points where they may tie


def decided(
    ranked: Sequence[RegisteredCandidate], options: LocalizeOptions
) -> tuple[Reason | None, float, list[float]]:
    """Why the best of the ranked poses is not the answer, its probability, and the share of each."""
    best = ranked[0]
    calibration, features = best.index.calibration, features_of(ranked)
    probability = calibration.probability(features)
    reason = _why_not_localized(features, calibration, threshold_at(best, options))
    if reason in (None, Reason.SEVERAL_PLACES) and best.is_better_outside:
        reason = Reason.LOW_PROBABILITY  # a better place is known, and the prior excludes it
    if reason is None and not best.registration.rests:
        reason = Reason.NOT_CONVERGED
    if reason is Reason.SEVERAL_PLACES:
        probability = _of_several(ranked, features)
    return reason, probability, _shares(ranked, features.tied, probability)


def features_of(ranked: Sequence[RegisteredCandidate], number: int = 0) -> MatchFeatures:
    """Match features of one of the ranked candidates, for the calibration of its own map.

    The evidence of several spots adds up: places that look alike from one rarely do from all. Support is a
    mean over the scans, so the margin counts once for each spot (docs/method.md section 7). Places outside a
    prior are rivals only if they are better: which of those that tie is right, the prior says.
    """
    one = ranked[number]
    alike = [
        n for n, other in enumerate(ranked) if not number and other.is_alike and other.map_id == one.map_id
    ]
    features = one.index.config.ranking.match_features(
        [candidate.quality for candidate in ranked],
        one.index.calibration.min_margin,
        number,
        [candidate.support for candidate in ranked],
        alike,
    )
    if one.is_better_outside:
        features = replace(features, margin=min(features.margin, -one.outside_lead))
    return features if one.spots == 1 else replace(features, margin=one.spots * features.margin)


def threshold_at(best: RegisteredCandidate, options: LocalizeOptions) -> float | None:
    """The threshold for a candidate; None: its map's own."""
    asked, calibration = threshold_of(best.index, options), best.index.calibration
    if asked is None and best.registration.is_in_motion:
        least, most = _IN_MOTION
        return max(calibration.min_probability, least, min(calibration.search_until, most))
    return asked


def _why_not_localized(
    best: MatchFeatures, calibration: Calibration, min_probability: float | None
) -> Reason | None:
    """First reason against the best candidate, or None: it is accepted.

    Places that tie are never localized, so one of them need only be likely, whatever the caller's threshold.
    """
    needed = calibration.min_probability if min_probability is None else min_probability

    def would_do(changed: MatchFeatures) -> bool:
        return calibration.probability(changed) >= needed

    if best.quality.inlier_ratio < calibration.min_inlier_ratio:
        return Reason.LOW_INLIER_RATIO
    if best.quality.free_space_violation > calibration.max_free_space_violation:
        return Reason.FREE_SPACE_VIOLATION
    if calibration.accepts(best, min_probability):
        return None
    if best.tied > 1 and calibration.probability(best) >= best.ranking.likely:
        return Reason.SEVERAL_PLACES
    if calibration.accepts(best.without_rivals, max(needed, calibration.search_until)):
        return Reason.SEVERAL_PLACES
    if would_do(replace(best, quality=replace(best.quality, free_space_violation=0.0))):
        return Reason.FREE_SPACE_VIOLATION
    return Reason.LOW_PROBABILITY


def _of_several(ranked: Sequence[RegisteredCandidate], features: MatchFeatures) -> float:
    """Probability that one of the places that tie is right, blurred over where a tie ends.

    Each number of places counts as far as the next one's lead is beyond the end. So the same scan in another
    encoding, whose leads differ by little, has nearly the same probability.

    Args:
        features: of the best one.
    """
    best, calibration = ranked[0], ranked[0].index.calibration
    leads = sorted(best.support - one.support for one in ranked)
    furthest = leads[features.tied - 1]
    # known aliases tie further than others, and surely
    end = calibration.min_margin if furthest < calibration.min_margin else furthest + BLUR
    ties = [1.0, *(min(max((end + BLUR - lead) / (2 * BLUR), 0.0), 1.0) for lead in leads[1:]), 0.0]
    probability = 0.0
    for tied, (within, beyond) in enumerate(pairwise(ties), 1):
        if within > beyond:
            lead = best.spots * leads[min(tied, len(leads) - 1)]
            margin = features.margin if len(leads) == 1 else lead
            probability += (within - beyond) * _of_tied(ranked, tied, margin)
    return probability


def _of_tied(ranked: Sequence[RegisteredCandidate], tied: int, margin: float) -> float:
    """Probability by the fit of each of the first places, weighted by the chance that it leads."""
    total = weights = 0.0
    for one in ranked[: min(tied, MEASURED_FINELY)]:
        weight = exp((one.support - ranked[0].support) / _ROUNDING)
        asked = MatchFeatures(one.quality, margin, tied, one.index.config.ranking)
        total += weight * one.index.calibration.probability(asked)
        weights += weight
    return total / weights


def _shares(ranked: Sequence[RegisteredCandidate], tied: int, probability: float) -> list[float]:
    """Probability of each candidate: equal for those that tie; others get at most the remainder."""
    others = [
        candidate.index.calibration.probability(features_of(ranked, number))
        for number, candidate in enumerate(ranked[tied:], tied)
    ]
    return [probability / tied] * tied + [min(other, 1 - probability) for other in others]
