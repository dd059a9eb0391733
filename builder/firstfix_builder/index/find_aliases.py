"""Finds the known aliases of a map's templates: each is searched for as if its scan were a query."""

from __future__ import annotations

import math
import os
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from firstfix.engine.candidates import SPOT_DEG, SPOT_M
from firstfix.engine.config import AliasConfig
from firstfix.engine.retrieval.alias_table import AliasTable
from firstfix.engine.retrieval.cascade import Cascade, Matches
from firstfix.native import spread_out

AT_ONCE = 256  # templates of one task
_SPOT_COS = math.cos(math.radians(SPOT_DEG))


def find_aliases(cascade: Cascade, config: AliasConfig) -> AliasTable:
    """Aliases of every template: the most similar ones elsewhere, one for each SPOT_M and SPOT_DEG.

    A template costs as much as the search of one query. The result does not depend on the number of threads.
    """
    count = len(cascade.templates)
    table = AliasTable.none(count, config.each)

    def fill(first: int) -> None:
        for template in range(first, min(first + AT_ONCE, count)):
            found = aliases_of(cascade, template, config)
            table.put(template, found.rows, found.yaw_rad, found.score)

    with ThreadPoolExecutor(os.cpu_count()) as threads:
        list(threads.map(fill, range(0, count, AT_ONCE)))
    return table


def aliases_of(cascade: Cascade, template: int, config: AliasConfig) -> Matches:
    """One template's aliases, most similar first. The same spot with the same heading is none."""
    templates = cascade.templates
    found = cascade.search(templates.described_at(np.array([template])), config.clusters)
    position_m = np.array(templates.position_m[found.rows], np.float64)
    yaw_rad = found.yaw_rad.astype(np.float64)
    away_m = np.linalg.norm(position_m - templates.position_m[template], axis=1)
    elsewhere = np.flatnonzero((away_m >= SPOT_M) | (np.cos(yaw_rad) <= _SPOT_COS))
    chosen = spread_out(position_m[elsewhere], yaw_rad[elsewhere], config.each, SPOT_M, _SPOT_COS, 1)
    kept = elsewhere[chosen]
    return Matches(found.rows[kept], yaw_rad[kept], found.score[kept])
