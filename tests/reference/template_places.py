"""Places that look like that of a pose, and those right above and below it, in NumPy.

``native.SearchedMap.known_aliases`` and ``native.TemplatePlaces.stacked`` are held against it.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from firstfix.answer.prior import Prior
from firstfix.engine.candidates import Candidates
from firstfix.engine.index import MapIndex
from firstfix.engine.retrieval.alias_table import NONE, AliasTable
from firstfix.engine.retrieval.cascade import Templates
from firstfix.native import STACKED_WITHIN_M, STOREY_M
from firstfix.transform import Matrix
from tests.reference.distinct import distinct
from tests.reference.found_candidates import YAW_SLACK_DEG

_MOST = 4  # floors, nearest first: of a tower


def known_aliases(index: MapIndex, T_level_sensor: Matrix, prior: Prior | None) -> Candidates:
    """See ``firstfix.engine.known_aliases.known_aliases``.

    Args:
        prior: poses that it does not allow are left out.
    """
    if index.aliases is None:
        return Candidates.merged([])
    config, cascade = index.config.search.aliases, index.cascade
    at_m, templates = T_level_sensor[:3, 3], cascade.templates
    rows = cascade.tiles.within(templates.position_m, at_m, config.near_m)
    away_m = np.linalg.norm(templates.position_m[rows] - at_m, axis=1)
    near = rows[np.argsort(away_m, kind="stable")[: config.templates]]
    if not len(near):
        return Candidates.merged([])
    own, alias, yaw_rad, score = aliases_of(index.aliases, near)
    T_alias = _moved(T_level_sensor, _floor_m(templates, own), _floor_m(templates, alias), yaw_rad)
    found = Candidates.merged([stacked_places(index, T_level_sensor), Candidates(alias, T_alias, score)])
    if prior is not None:
        T_map_sensor = index.T_map_level @ found.T_level_sensor
        found = found.at(
            np.flatnonzero(prior.allows_each(T_map_sensor, index.config.spacing_m, YAW_SLACK_DEG))
        )
    return found.at(distinct(found.T_level_sensor, index.config.ranking, most=config.screened))


def aliases_of(
    table: AliasTable, templates: NDArray[np.integer]
) -> tuple[NDArray[np.integer], NDArray[np.int32], NDArray[np.float64], NDArray[np.float64]]:
    """See ``firstfix.engine.retrieval.alias_table.AliasTable.of``."""
    row, score = table.row[templates], table.score[templates]
    own, number = np.nonzero(row != NONE)
    order = np.argsort(-score[own, number].astype(np.int64), kind="stable")
    own, number = own[order], number[order]
    yaw_rad = table.turn[templates[own], number] * (2 * math.pi / 256)
    return templates[own], row[own, number], yaw_rad, score[own, number] / 255


def stacked_places(index: MapIndex, T_level_sensor: Matrix) -> Candidates:
    """The pose moved to the other floors on which the map has templates near by, nearest floor first.

    Args:
        T_level_sensor: (4, 4) the pose.

    Returns:
        Candidates of score 1; none where there is one floor.
    """
    templates, at_m = index.cascade.templates, T_level_sensor[:3, 3]
    on_level_m = np.linalg.norm(templates.position_m[:, :2] - at_m[:2], axis=1)
    rows = np.flatnonzero(on_level_m <= STACKED_WITHIN_M)
    if not len(rows):
        return Candidates.merged([])
    position_m = np.array(templates.position_m[rows], np.float64)
    floor_m = position_m[:, 2] - templates.height_m[rows]
    own_m = floor_m[np.argmin(np.linalg.norm(position_m - at_m, axis=1))]
    away_m = np.abs(floor_m - own_m)
    found: list[int] = []
    for number in np.argsort(np.linalg.norm(position_m[:, :2] - at_m[:2], axis=1), kind="stable").tolist():
        others_m = floor_m[found]
        if away_m[number] > STOREY_M and (np.abs(others_m - floor_m[number]) > STOREY_M).all():
            found.append(number)
    found = sorted(found, key=lambda number: away_m[number])[:_MOST]
    T = np.repeat(T_level_sensor[None], len(found), axis=0)
    T[:, 2, 3] += floor_m[found] - own_m
    return Candidates(rows[found], T, np.ones(len(found)))


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
