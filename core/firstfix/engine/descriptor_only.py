"""Answers to descriptor-only queries: similar templates, never registered, so never ``localized``."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..answer.localization import Hypothesis, Localization, Reason, Verdict
from ..answer.options import LocalizeOptions
from ..errors import DescriptorMismatch
from ..scan.compact import ScanDescriptor
from ..scan.levelling import levelling_rotation
from ..transform import Matrix
from .candidates import find_candidates
from .index import MapIndex
from .ranking import RANKING, CandidatesConfig, ProbabilityConfig

MAX_HYPOTHESES = 10


@dataclass(frozen=True)
class UnregisteredCandidate:
    """A pose in one map at which the scan's descriptor resembles a template's.

    Attributes:
        T_map_sensor: (4, 4).
        score: 0..1, similarity of the two descriptors.
        template: row of the template.
        map_id: of the map, where several compete.
        ranking: the numbers of the map.
    """

    T_map_sensor: Matrix
    score: float
    template: int
    map_id: str = ""
    ranking: ProbabilityConfig = RANKING


@dataclass(frozen=True)
class _LevelledScan:
    R_level_sensor: NDArray[np.float64]
    height_m: float


def find_unregistered(
    index: MapIndex, sent: ScanDescriptor, options: LocalizeOptions, map_id: str = ""
) -> list[UnregisteredCandidate]:
    """Distinct candidates of one map that the prior allows, best first.

    Raises:
        DescriptorMismatch: the robot's descriptor has other parameters than the map's templates.
    """
    descriptor = index.cascade.descriptor
    if not sent.agrees_with(descriptor):
        raise DescriptorMismatch(
            f"map {map_id or 'asked'} has other descriptor parameters than the query's {sent.descriptor}: "
            "take them from engine in the map's manifest, or send points too"
        )
    scan = _LevelledScan(levelling_rotation(sent.up), sent.height_m)
    found = find_candidates(index, sent.rows, scan, options, index.config.search.widened)
    distinct = found.at(_distinct(found.T_level_sensor, index.config.ranking))
    T_map_sensor = index.T_map_level @ distinct.T_level_sensor
    return [
        UnregisteredCandidate(T, score, template, map_id, index.config.ranking)
        for T, score, template in zip(
            T_map_sensor, distinct.score.tolist(), distinct.template.tolist(), strict=True
        )
    ]


def answer_unregistered(candidates: Sequence[UnregisteredCandidate]) -> Localization:
    """Answer from the candidates of one map or several: ranked hypotheses, no pose."""
    ranked = sorted(candidates, key=lambda candidate: -candidate.score)
    if not ranked:
        return Localization(Verdict.REJECTED, (Reason.NO_CANDIDATE,))
    hypotheses = tuple(
        Hypothesis(one.T_map_sensor, None, _probability(ranked, number), one.template, one.map_id)
        for number, one in enumerate(ranked[:MAX_HYPOTHESES])
    )
    return Localization(
        Verdict.AMBIGUOUS,
        (Reason.NOT_REGISTERED,),
        probability=hypotheses[0].probability,
        hypotheses=hypotheses,
    )


def _probability(ranked: Sequence[UnregisteredCandidate], number: int) -> float:
    """Probability that a candidate is right, from its score and its lead over the best other one."""
    ranking, score = ranked[number].ranking, ranked[number].score
    rivals = [one.score for other, one in enumerate(ranked) if other != number]
    lead = score - max(rivals, default=0.0)
    log_odds = (
        ranking.unregistered_bias + ranking.unregistered_score * score + ranking.unregistered_lead * lead
    )
    return 1 / (1 + math.exp(-log_odds))


def _distinct(T_level_sensor: NDArray[np.float64], ranking: CandidatesConfig) -> NDArray[np.intp]:
    """Rows of the (k, 4, 4) poses, best first, of which each place has only the best."""
    R, position_m = T_level_sensor[:, :3, :3].reshape(-1, 9), T_level_sensor[:, :3, 3]
    same_cosine = math.cos(math.radians(ranking.same_place_deg))
    kept, left = [], np.arange(len(T_level_sensor))
    while len(left):
        best = left[0]
        kept.append(best)
        is_near = np.linalg.norm(position_m[left] - position_m[best], axis=1) < ranking.same_place_m
        trace = R[left] @ R[best]  # of the rotation between the two
        is_alike = trace > 1 + 2 * same_cosine
        left = left[1:][~(is_near & is_alike)[1:]]
    return np.array(kept, np.intp)
