"""Which known aliases of a pose may change the answer, in NumPy: ``native.Search`` is held against it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from firstfix.engine.candidates import Candidates
from firstfix.engine.index import MapIndex
from firstfix.engine.ranking import CandidatesConfig
from firstfix.engine.registered_candidate import RegisteredCandidate
from firstfix.engine.registration.surface import Surface
from firstfix.native import STACKED_WITHIN_M, STOREY_M
from firstfix.transform import Matrix
from tests.reference.distinct import distinct
from tests.reference.verdict import features_of


def rivals_among(
    aliases: Candidates, best: RegisteredCandidate, sparse: Surface, min_probability: float | None
) -> Candidates:
    """The aliases that could change the answer: most poses have none, and need not be judged again.

    First all but those right above and below are screened together with the pose. Those that are not far
    behind it are then aligned with few points, and so is the pose: with many points it would look better than
    its aliases for that reason alone.
    Free space is not checked at the aliases: it only lowers support. A scan in motion is deskewed by the
    motion at the pose, which it would have at an alias as well.

    Args:
        aliases: to be tried.
        best: the pose that would be answered.
        sparse: the scan's few points.
        min_probability: threshold to use instead of the calibration's own.
    """
    if not len(aliases):
        return aliases
    index, T_best = best.index, best.registration.T_level_sensor
    surface, ranking, calibration = index.surface, index.config.ranking, index.calibration
    sparse = sparse.deskewed(best.registration.twist)
    stacked = is_stacked(T_best[:3, 3], aliases.T_level_sensor[:, :3, 3])
    beside = not_far_behind(index, aliases.at(np.flatnonzero(~stacked)), T_best, sparse)
    aliases = Candidates.merged([aliases.at(np.flatnonzero(stacked)), beside])
    if not len(aliases):
        return aliases
    starts = np.concatenate([T_best[None], aliases.T_level_sensor])
    near, _ = surface.align_coarse(sparse, starts)
    own, *others = surface.align(sparse, near)
    placed_best, alone = replace(best, registration=own), features_of([best])

    def is_rival(other: RegisteredCandidate) -> bool:
        T_level_sensor = other.registration.T_level_sensor
        if len(distinct(np.array([T_best, T_level_sensor]), ranking)) == 1:  # a minimum of the same place
            return other.registration.alignment_score > own.alignment_score + ranking.maybe_better_by
        led = replace(alone, margin=best.spots * (placed_best.support - other.support))
        return may_tie(placed_best, other) or not calibration.accepts(led, min_probability)

    placed = [
        RegisteredCandidate(index, best.map_id, template, registration)
        for template, registration in zip(aliases.template.tolist(), others, strict=True)
    ]
    return aliases.at(np.flatnonzero([is_rival(one) for one in placed]))


def may_tie(best: RegisteredCandidate, alias: RegisteredCandidate) -> bool:
    """Whether a known alias of the best place may tie with it, before its free space is checked."""
    index, placed = best.index, best.registration
    other_m = alias.registration.T_level_sensor[None, :3, 3]
    is_doubtful = placed.is_in_motion or bool(is_stacked(placed.T_level_sensor[:3, 3], other_m)[0])
    reach = index.config.ranking.rival_within if is_doubtful else index.calibration.alias_margin
    return best.support - alias.support < reach


def not_far_behind(
    index: MapIndex, aliases: Candidates, T_level_sensor: Matrix, sparse: Surface
) -> Candidates:
    """The few aliases of a pose at which a probe finds the scan to fit nearly as well.

    Args:
        T_level_sensor: (4, 4) the pose.
        sparse: the scan's few points, deskewed.
    """
    config = index.config.search.aliases
    _, screened = index.surface.screen(sparse, np.concatenate([T_level_sensor[None], aliases.T_level_sensor]))
    order = np.argsort(-screened[1:], kind="stable")[: config.tried]
    return aliases.at(order[screened[1:][order] >= screened[0] - config.behind])


def is_any_of(
    aliases: NDArray[np.float64], T_level_sensor: NDArray[np.float64], ranking: CandidatesConfig
) -> NDArray[np.bool_]:
    """(n,) which of (n, 4, 4) poses are nearly the same as one of (k, 4, 4) aliases."""
    off_m = np.linalg.norm(T_level_sensor[:, None, :3, 3] - aliases[None, :, :3, 3], axis=2)
    trace = np.einsum("nij,kij->nk", T_level_sensor[:, :3, :3], aliases[:, :3, :3])
    same_cosine = math.cos(math.radians(ranking.same_pose_deg))
    found: NDArray[np.bool_] = ((off_m < ranking.same_pose_m) & (trace > 1 + 2 * same_cosine)).any(axis=1)
    return found


def is_stacked(at_m: NDArray[np.float64], others_m: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(k,) which of (k, 3) positions are above or below one, (3,)."""
    away_m = np.abs(others_m - at_m)
    found: NDArray[np.bool_] = (np.hypot(away_m[:, 0], away_m[:, 1]) < STACKED_WITHIN_M) & (
        away_m[:, 2] > STOREY_M
    )
    return found
