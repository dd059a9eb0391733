"""Which answer the evidence allows: localized, ambiguous or rejected, with its reasons."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from ..answer.localization import Hypothesis, Reason, Verdict
from ..answer.quality import MAX_MARGIN, MatchFeatures
from ..transform import Matrix
from .hypotheses import Place
from .index import MapIndex


@dataclass(frozen=True)
class Claim:
    """A place in a map that may be where the scan was taken.

    Attributes:
        map_id: of the map, where several compete.
    """

    place: Place
    index: MapIndex
    map_id: str = ""

    @property
    def T_map_sensor(self) -> Matrix:
        return self.index.T_map_level @ self.place.registration.T_level_sensor


@dataclass(frozen=True)
class Judgement:
    """The verdict on ranked hypotheses.

    Attributes:
        probability: 0..1 that the true place is the best hypothesis, or one of those that tie with it.
    """

    verdict: Verdict
    reasons: tuple[Reason, ...]
    hypotheses: tuple[Hypothesis, ...]
    probability: float


def judge(claims: Sequence[Claim], min_probability: float | None) -> Judgement:
    """Says what may be claimed of ranked places, each by the calibration of its own map.

    Args:
        claims: distinct, best first.
        min_probability: the caller's threshold, or None for the calibration's.
    """
    if not claims:
        return Judgement(Verdict.REJECTED, (Reason.NO_CANDIDATE,), (), 0.0)
    calibration = claims[0].index.calibration
    needed = calibration.min_probability if min_probability is None else min_probability
    best = calibration.match_features([claim.place.quality for claim in claims])
    probability = calibration.probability(best)
    hypotheses = tuple(
        Hypothesis(claim.T_map_sensor, claim.place.quality, share, claim.place.template, claim.map_id)
        for claim, share in zip(claims, _shares(claims, best.tied, probability), strict=True)
    )

    def judged(verdict: Verdict, *reasons: Reason) -> Judgement:
        return Judgement(verdict, reasons, hypotheses, probability)

    def would_do(changed: MatchFeatures) -> bool:
        return calibration.probability(changed) >= needed

    if best.quality.inlier_ratio < calibration.min_inlier_ratio:
        return judged(Verdict.REJECTED, Reason.LOW_INLIER_RATIO)
    if calibration.accepts(best, min_probability):
        return judged(Verdict.LOCALIZED)
    if would_do(replace(best, margin=MAX_MARGIN)):  # but for its rivals, tied or not
        return judged(Verdict.AMBIGUOUS, Reason.SEVERAL_PLACES)
    if would_do(replace(best, quality=replace(best.quality, free_space_violation=0.0))):
        return judged(Verdict.REJECTED, Reason.FREE_SPACE_VIOLATION)
    return judged(Verdict.REJECTED, Reason.LOW_PROBABILITY)


def _shares(claims: Sequence[Claim], tied: int, probability: float) -> list[float]:
    """Each place's part: those that tie have equal ones, the others at most what these leave."""
    fits = [claim.place.quality for claim in claims]
    others = [
        claim.index.calibration.probability(claim.index.calibration.match_features(fits, number))
        for number, claim in enumerate(claims[tied:], tied)
    ]
    return [probability / tied] * tied + [min(other, 1 - probability) for other in others]
