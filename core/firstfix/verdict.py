"""Which answer the evidence allows: localized, ambiguous or rejected, with its reasons."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from .calibration import Calibration
from .evidence import MOST_MARGIN, Evidence, evidence
from .localization import Hypothesis, Reason, Verdict
from .places import Place
from .transform import Matrix


@dataclass(frozen=True)
class Judgement:
    """The verdict on ranked hypotheses; ``probability`` is the best one's."""

    verdict: Verdict
    reasons: tuple[Reason, ...]
    hypotheses: tuple[Hypothesis, ...]
    probability: float


def judge(
    places: Sequence[Place], T_map_level: Matrix, calibration: Calibration, min_probability: float | None
) -> Judgement:
    """Says what may be claimed of ranked places.

    Args:
        places: distinct, best first.
        min_probability: the caller's threshold, or None for the calibration's.
    """
    if not places:
        return Judgement(Verdict.REJECTED, (Reason.NO_CANDIDATE,), (), 0.0)
    fits = [place.fit for place in places]
    hypotheses = tuple(
        Hypothesis(
            T_map_level @ place.registration.T_level_sensor,
            place.fit,
            calibration.probability(evidence(fits, number)),
            place.template,
        )
        for number, place in enumerate(places)
    )
    needed = calibration.min_probability if min_probability is None else min_probability
    best, probability = evidence(fits), hypotheses[0].probability

    def judged(verdict: Verdict, *reasons: Reason) -> Judgement:
        return Judgement(verdict, reasons, hypotheses, probability)

    def would_do(changed: Evidence) -> bool:
        return calibration.probability(changed) >= needed

    if best.fit.overlap < calibration.min_overlap:
        return judged(Verdict.REJECTED, Reason.LOW_OVERLAP)
    if probability >= needed and best.margin >= calibration.min_margin:
        return judged(Verdict.LOCALIZED)
    if would_do(replace(best, margin=MOST_MARGIN)):  # but for its rivals
        return judged(Verdict.AMBIGUOUS, Reason.SEVERAL_PLACES)
    if would_do(replace(best, fit=replace(best.fit, seen_through=0.0))):
        return judged(Verdict.REJECTED, Reason.FREE_SPACE_VIOLATION)
    return judged(Verdict.REJECTED, Reason.LOW_PROBABILITY)
