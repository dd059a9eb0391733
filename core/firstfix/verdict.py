"""Which answer the evidence allows: localized, ambiguous or rejected, with its reasons."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .calibration import Calibration
from .localization import Hypothesis, Reason, Verdict
from .registration import Registration
from .transform import Matrix, pose_error

SAME_PLACE_M = 1.0
SAME_PLACE_DEG = 15.0


@dataclass(frozen=True)
class Judgement:
    """The verdict on ranked hypotheses; ``margin`` is over the best one at another place."""

    verdict: Verdict
    reasons: tuple[Reason, ...]
    hypotheses: tuple[Hypothesis, ...]
    overlap: float
    margin: float


def same_place(T_a: Matrix, T_b: Matrix) -> bool:
    distance_m, angle_deg = pose_error(T_a, T_b)
    return distance_m < SAME_PLACE_M and angle_deg < SAME_PLACE_DEG


def judge(
    registered: Sequence[tuple[int, Registration]],
    T_map_level: Matrix,
    calibration: Calibration,
    min_probability: float | None,
) -> Judgement:
    """Says what may be claimed of ranked places.

    Args:
        registered: (template row, where the scan settled), one for each distinct place, best first.
        min_probability: the caller's threshold, or None for the calibration's.
    """
    if not registered:
        return Judgement(Verdict.REJECTED, (Reason.NO_CANDIDATE,), (), 0.0, 0.0)
    overlaps = np.array([r.overlap for _, r in registered])
    rivals = [float(np.delete(overlaps, i).max(initial=0.0)) for i in range(len(overlaps))]
    hypotheses = tuple(
        Hypothesis(
            T_map_level @ r.T_level_sensor,
            r.overlap,
            calibration.probability(r.overlap, r.overlap - rival),
            row,
        )
        for (row, r), rival in zip(registered, rivals, strict=True)
    )
    best, margin = hypotheses[0], float(overlaps[0] - rivals[0])
    needed = calibration.min_probability if min_probability is None else min_probability
    reasons: tuple[Reason, ...] = ()
    if best.score < calibration.min_overlap:
        verdict, reasons = Verdict.REJECTED, (Reason.LOW_OVERLAP,)
    elif best.probability >= needed:
        verdict = Verdict.LOCALIZED
    elif calibration.probability(best.score, best.score) >= needed:  # alone, it would have been accepted
        verdict, reasons = Verdict.AMBIGUOUS, (Reason.SEVERAL_PLACES,)
    else:
        verdict, reasons = Verdict.REJECTED, (Reason.LOW_PROBABILITY,)
    return Judgement(verdict, reasons, hypotheses, best.score, margin)
