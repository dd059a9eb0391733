"""What a descriptor alone can say: places that look alike, registered nowhere, so never ``localized``."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..answer.localization import Hypothesis, Localization, Reason, Verdict
from ..answer.options import LocalizeOptions
from ..errors import DescriptorMismatch
from ..scan.compact import ScanDescriptor
from ..scan.levelling import levelling_rotation
from ..transform import Matrix, pose_error
from .candidates import Candidate, search
from .index import MapIndex

APART_M, APART_DEG = 3.0, 30.0  # nearer candidates are one place: templates stand a metre apart
HYPOTHESES = 10
# The likeliest logistic model of "the best is right" over ten places, a fifth of the scans of other ones.
# Asked of the place that it was not fitted to, it is off by 0.03 on average (docs/method.md section 3).
BIAS, SCORE, LEAD = -7.84, 10.07, 52.1


@dataclass(frozen=True)
class Proposal:
    """A place in a map. Attributes as a ``Hypothesis`` has them; ``score`` is the descriptors', 0..1."""

    T_map_sensor: Matrix
    score: float
    template: int
    map_id: str = ""


@dataclass(frozen=True)
class _LevelledScan:
    R_level_sensor: NDArray[np.float64]
    height_m: float
    T_last_scan: Matrix = field(default_factory=lambda: np.eye(4))


def propose(
    index: MapIndex, sent: ScanDescriptor, options: LocalizeOptions, map_id: str = ""
) -> list[Proposal]:
    """Distinct places of one map that the prior allows, the most alike first.

    Raises:
        DescriptorMismatch: the robot described the scan otherwise than the map's templates.
    """
    descriptor = index.cascade.descriptor
    if not sent.agrees_with(descriptor):
        raise DescriptorMismatch(
            f"map {map_id or 'asked'} has other descriptor parameters than the query's {sent.descriptor}: "
            "take them from engine in the map's manifest, or send points too"
        )
    scan = _LevelledScan(levelling_rotation(sent.up), sent.height_m)
    found = search(index, [sent.rows], [scan], options, index.config.search.widened)
    return [
        Proposal(index.T_map_level @ candidate.T_level_sensor, candidate.score, candidate.template, map_id)
        for candidate in _distinct(found)
    ]


def answer_unregistered(proposals: Sequence[Proposal]) -> Localization:
    """Ranked hypotheses of one map or several, and no pose."""
    ranked = sorted(proposals, key=lambda proposal: -proposal.score)
    if not ranked:
        return Localization(Verdict.REJECTED, (Reason.NO_CANDIDATE,))
    hypotheses = tuple(
        Hypothesis(one.T_map_sensor, None, _probability(ranked, number), one.template, one.map_id)
        for number, one in enumerate(ranked[:HYPOTHESES])
    )
    return Localization(
        Verdict.AMBIGUOUS,
        (Reason.NOT_REGISTERED,),
        probability=hypotheses[0].probability,
        hypotheses=hypotheses,
    )


def _probability(ranked: Sequence[Proposal], number: int) -> float:
    """Of being right: how alike the place is, and how much more than the best other one."""
    score = ranked[number].score
    rivals = [one.score for other, one in enumerate(ranked) if other != number]
    lead = score - max(rivals, default=0.0)
    return 1 / (1 + math.exp(-(BIAS + SCORE * score + LEAD * lead)))


def _distinct(candidates: Sequence[Candidate]) -> list[Candidate]:
    """The first of every place, in order."""
    kept: list[Candidate] = []
    for candidate in candidates:
        offs = (pose_error(candidate.T_level_sensor, known.T_level_sensor) for known in kept)
        if not any(off_m < APART_M and off_deg < APART_DEG for off_m, off_deg in offs):
            kept.append(candidate)
    return kept
