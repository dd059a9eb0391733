"""One query's answer beside the truth."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from firstfix.answer.localization import Localization, Verdict
from firstfix.answer.quality import AlignmentQuality
from firstfix.engine.localizer import Localizer
from firstfix.engine.preprocess import preprocess
from firstfix.engine.ranking import RANKING
from firstfix.scan.scan import Scan
from firstfix.scan.sequence import ScanSequence
from firstfix.transform import Matrix, inverse, pose_error, quaternion_of

from ...common.nees import pose_difference
from ...evaluation.outcome import WRONG_M

RIGHT_M, RIGHT_DEG = 1.0, 10.0  # further off, an answer "localized" is a false accept
SUCCESS_YAW_DEG = 5.0
ALIAS_WITHIN = 0.02  # of the truth's alignment score
NEVER = (np.inf, np.inf, np.inf)


class Standing(Enum):
    """The true pose among the other places that were found, when the scan is registered from the truth.

    DISTINCT: it explains the scan best, by more than ALIAS_WITHIN of its alignment score.
    ALIAS: another place explains it as well.
    OUTSHONE: another explains it better, because the map lacks what the scan shows.
    """

    DISTINCT = "distinct"
    ALIAS = "alias"
    OUTSHONE = "outshone"


@dataclass(frozen=True)
class Outcome:
    """One query's answer compared with the truth.

    Attributes:
        templates, sensor: of the map and of the scan.
        inside: whether the scan is of this map.
        verdict, probability: the answer's.
        hypotheses: how many came back.
        error_m, error_deg, yaw_error_deg: of the best hypothesis; inf without one, or outside.
        nearest_m: least error among all hypotheses whose yaw is right; inf without one.
        standing: of the truth among the other places; no matcher can be sure where it is not DISTINCT.
            Outside the map: DISTINCT.
        nees: e' P^-1 e of an answer with a covariance (6 degrees of freedom), nan without one.
        ms: of the query, in this process.
    """

    world: str
    case: str
    templates: str
    sensor: str
    inside: bool
    verdict: Verdict
    probability: float
    hypotheses: int
    error_m: float
    error_deg: float
    yaw_error_deg: float
    nearest_m: float
    standing: Standing
    nees: float
    ms: float

    @property
    def has_alias(self) -> bool:
        """Another place explains the scan as well as the true pose does, or better."""
        return self.standing is not Standing.DISTINCT

    @property
    def is_localized(self) -> bool:
        return self.verdict is Verdict.LOCALIZED

    @property
    def is_right(self) -> bool:
        """The best hypothesis is the place."""
        return self.error_m <= RIGHT_M and self.error_deg <= RIGHT_DEG

    @property
    def is_false_accept(self) -> bool:
        return self.is_localized and not self.is_right

    @property
    def is_wrong(self) -> bool:
        """The answered pose is off by over 0.2 m, or a false accept."""
        return self.is_localized and (self.error_m > WRONG_M or not self.is_right)

    def is_within(self, limit_m: float) -> bool:
        return self.error_m <= limit_m and self.yaw_error_deg <= SUCCESS_YAW_DEG


def ask(
    localizer: Localizer,
    scan: Scan,
    T_map_sensor: Matrix | None,
    world: str,
    case: str,
    templates: str = "",
    sensor: str = "",
) -> Outcome:
    """Localize a scan; T_map_sensor None: it is not of this map."""
    began = time.perf_counter()
    answer = localizer.localize(scan)
    ms = 1e3 * (time.perf_counter() - began)
    errors = [
        NEVER if T_map_sensor is None else _errors(T_map_sensor, h.T_map_sensor) for h in answer.hypotheses
    ]
    best = errors[0] if errors else NEVER
    standing = (
        Standing.DISTINCT if T_map_sensor is None else standing_in(localizer, scan, T_map_sensor, answer)
    )
    return Outcome(
        world,
        case,
        templates,
        sensor,
        T_map_sensor is not None,
        answer.verdict,
        answer.probability,
        len(errors),
        *best,
        min((m for m, _, yaw_deg in errors if yaw_deg <= SUCCESS_YAW_DEG), default=np.inf),
        standing,
        np.nan if T_map_sensor is None else nees(T_map_sensor, answer),
        ms,
    )


def nees(T_map_sensor: Matrix, answer: Localization) -> float:
    """Normalized estimation error squared: with an honest covariance chi-squared, 6 degrees of freedom."""
    if answer.T_map_sensor is None or answer.covariance is None:
        return np.nan
    error = pose_difference(T_map_sensor, answer.T_map_sensor)
    return float(error @ np.linalg.solve(answer.covariance, error))


def standing_of(true: AlignmentQuality, rivals: Sequence[AlignmentQuality]) -> Standing:
    """Standing of the true pose among other places.

    Compared by support, whatever its formula: with what it would be if ALIAS_WITHIN more or less of the scan
    fitted.
    """
    best = max((RANKING.support(rival) for rival in rivals), default=-np.inf)
    score = true.alignment_score
    if best <= RANKING.support(replace(true, alignment_score=max(0.0, score - ALIAS_WITHIN))):
        return Standing.DISTINCT
    is_alias = best <= RANKING.support(replace(true, alignment_score=min(1.0, score + ALIAS_WITHIN)))
    return Standing.ALIAS if is_alias else Standing.OUTSHONE


def standing_in(localizer: Localizer, scan: Scan, T_map_sensor: Matrix, answer: Localization) -> Standing:
    """Standing of the truth among the places of an answer. Too few points never speak for it."""
    index = localizer.index
    prepared = preprocess(ScanSequence.single(scan), None, index.config.preprocess)
    if prepared is None:
        return Standing.OUTSHONE
    (found,) = index.surface.align_fine(prepared.dense, (inverse(index.T_map_level) @ T_map_sensor)[None])
    through = index.view.seen_through(index.surface, prepared.scans[0].view, found.T_level_sensor)
    true = AlignmentQuality(
        found.inlier_ratio, found.alignment_score, through.free_space_violation, through.removed_surface
    )
    elsewhere = [h for h in answer.hypotheses if pose_error(T_map_sensor, h.T_map_sensor)[0] > RIGHT_M]
    return standing_of(true, [hypothesis.quality for hypothesis in elsewhere])


def _errors(T_true: Matrix | None, T_found: Matrix) -> tuple[float, float, float]:
    """Metres, degrees of the whole rotation, degrees of its twist about the map's vertical."""
    if T_true is None:
        return NEVER
    _, _, z, w = quaternion_of(T_found @ inverse(T_true))
    return *pose_error(T_true, T_found), abs(float(np.degrees(2 * np.arctan2(z, w))))
