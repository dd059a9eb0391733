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

from .. import native
from ..answer.prior import Prior
from ..transform import Matrix
from .candidates import YAW_SLACK_DEG, Candidates
from .index import MapIndex
from .ranking import CandidatesConfig
from .registered_candidate import RegisteredCandidate, distinct
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


def is_any_of(
    aliases: NDArray[np.float64], T_level_sensor: NDArray[np.float64], ranking: CandidatesConfig
) -> NDArray[np.bool_]:
    """(n,) which of (n, 4, 4) poses are nearly the same as one of (k, 4, 4) aliases."""
    within_rad = math.radians(ranking.same_pose_deg)
    return native.is_any_of(T_level_sensor, aliases, ranking.same_pose_m, within_rad)


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
