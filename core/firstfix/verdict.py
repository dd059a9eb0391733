"""Which answer the evidence allows: localized, ambiguous or rejected, with its reasons."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from .calibration import Calibration
from .localization import Hypothesis, Reason, Verdict
from .places import Place, margin
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
    hypotheses = _hypotheses(places, T_map_level, calibration)
    overlap, probability = hypotheses[0].score, hypotheses[0].probability
    needed = calibration.min_probability if min_probability is None else min_probability

    def rejected(reason: Reason) -> Judgement:
        return Judgement(Verdict.REJECTED, (reason,), hypotheses, probability)

    if overlap < calibration.min_overlap:
        return rejected(Reason.LOW_OVERLAP)
    clear = margin([h.score for h in hypotheses]) >= calibration.min_margin
    if probability >= needed and clear:
        return Judgement(Verdict.LOCALIZED, (), hypotheses, probability)
    if calibration.probability(overlap, overlap) >= needed:  # without its rivals it would have been accepted
        return Judgement(Verdict.AMBIGUOUS, (Reason.SEVERAL_PLACES,), hypotheses, probability)
    return rejected(Reason.LOW_PROBABILITY)


def _hypotheses(
    places: Sequence[Place], T_map_level: Matrix, calibration: Calibration
) -> tuple[Hypothesis, ...]:
    """Each place with its probability, its margin being over the best of all the others."""
    overlaps = [place.registration.overlap for place in places]
    found = []
    for i, place in enumerate(places):
        rivals = overlaps[:i] + overlaps[i + 1 :]
        probability = calibration.probability(overlaps[i], margin([overlaps[i], *rivals]))
        T_map_sensor = T_map_level @ place.registration.T_level_sensor
        found.append(Hypothesis(T_map_sensor, overlaps[i], probability, place.template))
    return tuple(found)
