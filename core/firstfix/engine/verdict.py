"""The answer that ranked candidates allow: localized, ambiguous or rejected, with its reasons."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..answer.localization import Hypothesis, Localization, Reason, Verdict
from ..answer.options import LocalizeOptions
from ..errors import InvalidOption
from ..transform import Matrix, inverse
from .config import RegistrationConfig
from .hypotheses import RegisteredCandidate, features_of
from .index import MapIndex
from .ranking import Calibration, MatchFeatures


def judge(ranked: Sequence[RegisteredCandidate], options: LocalizeOptions) -> Localization:
    """Answer of one map or several, each candidate judged by the calibration of its own map.

    Args:
        ranked: distinct, best first.
    """
    if not ranked:
        return Localization(Verdict.REJECTED, (Reason.NO_CANDIDATE,))
    best, mounting = ranked[0], options.T_base_sensor
    calibration, features = best.index.calibration, features_of(ranked)
    probability = calibration.probability(features)
    hypotheses = tuple(
        Hypothesis(candidate.T_map_sensor, candidate.quality, share, candidate.template, candidate.map_id)
        for candidate, share in zip(ranked, _shares(ranked, features.tied, probability), strict=True)
    )
    reason = _why_not_localized(features, calibration, threshold_of(best.index, options))
    if reason is not None:
        verdict = Verdict.AMBIGUOUS if reason is Reason.SEVERAL_PLACES else Verdict.REJECTED
        return Localization(verdict, (reason,), probability=probability, hypotheses=hypotheses)
    information, config = best.registration.information, best.index.config.registration
    return Localization(
        Verdict.LOCALIZED,
        T_map_sensor=best.T_map_sensor,
        T_map_base=None if mounting is None else best.T_map_sensor @ inverse(mounting),
        covariance=pose_covariance(information, best.index.T_map_level, config),
        probability=probability,
        hypotheses=hypotheses,
        map_id=best.map_id,
        twist=best.registration.twist if options.twist is None else options.twist,
    )


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
    if would_do(best.without_rivals):
        return Reason.SEVERAL_PLACES
    if would_do(replace(best, quality=replace(best.quality, free_space_violation=0.0))):
        return Reason.FREE_SPACE_VIOLATION
    return Reason.LOW_PROBABILITY


def _shares(ranked: Sequence[RegisteredCandidate], tied: int, probability: float) -> list[float]:
    """Probability of each candidate: equal for those that tie; others get at most the remainder."""
    others = [
        candidate.index.calibration.probability(features_of(ranked, number))
        for number, candidate in enumerate(ranked[tied:], tied)
    ]
    return [probability / tied] * tied + [min(other, 1 - probability) for other in others]


# Neighbouring pairs share the errors of the map and of the surface model, so one pair in this many counts as
# an independent observation. With this number the errors on real maps agree with the covariance
# (docs/method.md section 7); in simulation, where the map has no error, they are smaller.
_PAIRS_PER_OBSERVATION = 20.0
_FLOOR_DEG = 0.02


def pose_covariance(
    information: NDArray[np.float64], T_map_level: Matrix, config: RegistrationConfig
) -> NDArray[np.float64]:
    """Covariance (6, 6) over x, y, z, rotX, rotY, rotZ about the map's axes, in m and rad.

    A direction that the scan does not constrain (along a corridor) has almost no information, and so a large
    variance. The variance never falls below a floor that the map's resolution sets.

    Args:
        information: (6, 6) over rotation then translation, along the level axes.
    """
    values, vectors = np.linalg.eigh((information + information.T) / 2)
    values = np.maximum(values / _PAIRS_PER_OBSERVATION, 1e-4)  # a standard deviation of 100 m or rad at most
    in_level = (vectors / values) @ vectors.T
    R = T_map_level[:3, :3]
    to_map = np.zeros((6, 6))
    to_map[:3, 3:] = R  # translation comes first in the answer, last in the registration
    to_map[3:, :3] = R
    covariance: NDArray[np.float64] = to_map @ in_level @ to_map.T
    floor_m = config.map_voxel_m / 20
    covariance[np.diag_indices(6)] += np.repeat([floor_m**2, np.radians(_FLOOR_DEG) ** 2], 3)
    return covariance
