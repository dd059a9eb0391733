"""Known aliases: where the sensor would stand in places that look alike (docs/method.md section 7.1).

A scan's own descriptor may miss the place that it was taken in. Another place that looks the same is then
accepted, because the right one was never compared with it. The templates around the wrong place know it, or
it is right above or below.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..answer.prior import Prior
from ..transform import Matrix
from .candidates import YAW_SLACK_DEG, Candidates
from .index import MapIndex
from .ranking import CandidatesConfig
from .registered_candidate import RegisteredCandidate, distinct, features_of
from .registration.surface import Surface
from .retrieval.cascade import Templates
from .stacked_places import is_stacked, stacked_places
from .told_apart import are_parted, is_one_thing, may_lack


def known_aliases(index: MapIndex, T_level_sensor: Matrix, prior: Prior | None) -> Candidates:
    """Poses right above and below a pose, then at aliases of the templates nearest to it, most alike first.

    None without a table.

    Args:
        index: of the map.
        T_level_sensor: (4, 4) the pose.
        prior: poses that it does not allow are left out.
    """
    config, cascade = index.config.search.aliases, index.cascade
    at_m, templates = T_level_sensor[:3, 3], cascade.templates
    rows = cascade.tiles.within(templates.position_m, at_m, config.near_m)
    away_m = np.linalg.norm(templates.position_m[rows] - at_m, axis=1)
    near = rows[np.argsort(away_m, kind="stable")[: config.templates]]
    if index.aliases is None or not len(near):
        return Candidates.merged([])
    own, alias, yaw_rad, score = index.aliases.of(near)
    T_alias = _moved(T_level_sensor, _floor_m(templates, own), _floor_m(templates, alias), yaw_rad)
    found = Candidates.merged([stacked_places(index, T_level_sensor), Candidates(alias, T_alias, score)])
    if prior is not None:
        T_map_sensor = index.T_map_level @ found.T_level_sensor
        found = found.at(
            np.flatnonzero(prior.allows_each(T_map_sensor, index.config.spacing_m, YAW_SLACK_DEG))
        )
    return found.at(distinct(found.T_level_sensor, index.config.ranking, most=config.screened))


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


def with_look_alikes_marked(
    registered: Sequence[RegisteredCandidate], prior: Prior | None
) -> list[RegisteredCandidate]:
    """The candidates of one map, best first, with those marked that the scan does not tell from the best.

    These are known aliases near the best one's support, and rivals right above or below that the map may
    lack. A scan in motion fits wrong places well, as each has three unknowns more: there all rivals are
    marked that the map may lack.
    """
    best, index = registered[0], registered[0].index
    ranking = index.config.ranking
    T_level_sensor = np.array([one.registration.T_level_sensor for one in registered])
    lead = best.support - np.array([one.support for one in registered])
    lacking = np.array(
        [may_lack(ranking, one.registration.alignment_score, one.quality, best.quality) for one in registered]
    )
    is_small = np.array([is_one_thing(ranking, one.quality, best.quality) for one in registered])
    aliases, at_m = known_aliases(index, T_level_sensor[0], prior).T_level_sensor, T_level_sensor[:, :3, 3]
    is_known = is_any_of(aliases, T_level_sensor, ranking)
    is_alike = is_known & (np.abs(lead) < index.calibration.alias_margin)
    is_alike &= ~are_parted(lead, lacking | is_small, at_m)
    doubted = lacking & (lead < ranking.rival_within)
    is_alike |= doubted if best.registration.is_in_motion else doubted & is_stacked(at_m[0], at_m)
    is_alike[0] = False
    return [replace(one, is_alike=alike) for one, alike in zip(registered, is_alike.tolist(), strict=True)]


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


def _floor_m(templates: Templates, rows: NDArray[np.integer]) -> NDArray[np.float64]:
    """Points (k, 3) of the floor below templates."""
    floor_m = np.array(templates.position_m[rows], np.float64)
    floor_m[:, 2] -= templates.height_m[rows]
    return floor_m


def _moved(
    T: Matrix, start_m: NDArray[np.float64], end_m: NDArray[np.float64], yaw_rad: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Poses (k, 4, 4): one pose, moved as (k, 3) points move to others while they turn about z."""
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    move = np.zeros((len(yaw_rad), 4, 4))
    move[:, 0, 0], move[:, 0, 1], move[:, 1, 0], move[:, 1, 1] = c, -s, s, c
    move[:, 2, 2] = move[:, 3, 3] = 1
    move[:, :3, 3] = end_m - np.einsum("kij,kj->ki", move[:, :3, :3], start_m)
    return move @ T
