"""Support and probability of a pose, in plain Python: the compiled formulas are held against it."""

from __future__ import annotations

from collections.abc import Sequence
from math import exp, log

import numpy as np
from numpy.typing import NDArray

from firstfix.answer.quality import AlignmentQuality
from firstfix.engine.calibration import WEIGHTS, Calibration
from firstfix.engine.ranking import RankingConfig


def support(ranking: RankingConfig, quality: AlignmentQuality) -> float:
    """Equation 7.1."""
    misfit = ranking.alignment_weight * log(ranking.best_score - quality.alignment_score)
    return -(misfit + meets_map(quality) * _seen_through(ranking, quality) + _in_free(ranking, quality))


def contradiction(ranking: RankingConfig, quality: AlignmentQuality) -> float:
    """The support that is lost where the scan does not show what the map has, or saw free."""
    return _seen_through(ranking, quality) + _in_free(ranking, quality)


def meets_map(quality: AlignmentQuality) -> float:
    """How far it counts that the scan does not contradict the map: as far as it meets the map at all."""
    return min(quality.inlier_ratio / 0.4, 1.0)


def _seen_through(ranking: RankingConfig, quality: AlignmentQuality) -> float:
    removed = ranking.removed_weight * log(ranking.least_share + quality.removed_surface)
    return removed + ranking.violation_weight * log(ranking.least_share + quality.free_space_violation)


def _in_free(ranking: RankingConfig, quality: AlignmentQuality) -> float:
    return ranking.seen_free_weight * log(1 + (quality.seen_free or 0.0) / ranking.seen_free_offset)


def discounted_score(ranking: RankingConfig, score: float, twist: NDArray[np.float64]) -> float:
    """The alignment score less for the motion."""
    linear, angular = twist[:3] / ranking.unlikely_m_s, twist[3:] / ranking.unlikely_rad_s
    odds = float((1 + linear @ linear) * (1 + angular @ angular))
    return max(
        ranking.best_score - (ranking.best_score - score) * odds ** (1 / ranking.motion_score_weight), 0.0
    )


def margin_and_tied(supports: Sequence[float], number: int, within: float, most: float) -> tuple[float, int]:
    """The lead of a pose over the best one that does not tie with it, and how many tie."""
    own = supports[number]
    rivals = [support for support in supports if abs(support - own) >= within]
    margin = most if len(supports) == 1 else own - (max(rivals) if rivals else min(supports))
    return margin, len(supports) - len(rivals)


def probability(
    calibration: Calibration, ranking: RankingConfig, quality: AlignmentQuality, margin: float, tied: int
) -> float:
    """Equation 7.2."""
    own = tuple(getattr(calibration, name) for name in WEIGHTS)
    bias, *weights = calibration.among_tied if tied > 1 and calibration.among_tied else own
    score, met = quality.alignment_score, meets_map(quality)
    inputs = (
        log((ranking.worst_score + score) / (ranking.best_score - score)),
        -met * log(ranking.violation_offset + quality.free_space_violation),
        -met * log(ranking.beside_offset + quality.beside_surface),
        -met * log(ranking.same_plane_offset + quality.same_plane),
        min(margin, ranking.max_margin),
    )
    odds = bias + sum(weight * value for weight, value in zip(weights, inputs, strict=True))
    return 1 / (1 + exp(-min(max(odds, -50.0), 50.0)))
