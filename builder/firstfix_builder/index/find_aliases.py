"""Finds the known aliases of a map's templates: each is searched for as if its scan were a query."""

from __future__ import annotations

import math
import os
from concurrent.futures import ThreadPoolExecutor

import faiss
import numpy as np
from numpy.typing import NDArray

from firstfix.engine.config import AliasConfig
from firstfix.engine.retrieval.alias_table import AliasTable
from firstfix.engine.retrieval.cascade import Cascade, Matches
from firstfix.engine.retrieval.key_search.faiss_indexes import FLAT_UP_TO
from firstfix.engine.retrieval.key_search.faiss_search import FaissSearch
from firstfix.engine.retrieval.key_search.key_lists import KeyLists
from firstfix.native import SPOT_DEG, SPOT_M, spread_out

# Templates of one task. FAISS multiplies matrices from 128,000 numbers of the searched keys on: 128 each.
AT_ONCE = 1024
_SPOT_COS = math.cos(math.radians(SPOT_DEG))


def find_aliases(cascade: Cascade, keys: NDArray[np.float32], config: AliasConfig) -> AliasTable:
    """Aliases of every template.

    Args:
        keys: (c, d) of the clusters, as they are searched.
    """
    count = len(cascade.templates)
    table = AliasTable.none(count, config.each)
    enter_aliases(cascade, keys, config, table, np.arange(count))
    return table


def enter_aliases(
    cascade: Cascade,
    keys: NDArray[np.float32],
    config: AliasConfig,
    table: AliasTable,
    templates: NDArray[np.int64],
) -> None:
    """Enter aliases of (n,) templates: the most similar ones elsewhere, one for each SPOT_M and SPOT_DEG.

    The result does not depend on the number of threads.

    Args:
        keys: (c, d) of the clusters, as they are searched.
        table: of all templates.
    """
    search = cascade.keys
    lists = search.key_lists() if len(keys) > FLAT_UP_TO and isinstance(search, FaissSearch) else None

    def fill(first: int) -> None:
        rows = templates[first : first + AT_ONCE]
        nearest = _nearest(cascade, keys, lists, rows, config.clusters)
        for template, clusters in zip(rows.tolist(), nearest, strict=True):
            found = aliases_of(cascade, template, clusters[clusters >= 0], config)
            table.put(template, found.rows, found.yaw_rad, found.score)

    with ThreadPoolExecutor(os.cpu_count()) as threads:
        list(threads.map(fill, range(0, len(templates), AT_ONCE)))


def _nearest(
    cascade: Cascade,
    keys: NDArray[np.float32],
    lists: KeyLists | None,
    rows: NDArray[np.int64],
    clusters: int,
) -> NDArray[np.int64]:
    """The clusters (n, at most ``clusters``) nearest by key to (n,) templates; -1: there are no more."""
    own = cascade.descriptor.keys(cascade.templates.described_at(rows))
    own = own if cascade.projection is None else own @ cascade.projection
    if lists is not None:
        return lists.search(own, clusters)
    faiss.omp_set_num_threads(1)  # as in FaissSearch: this thread is one of many
    found: NDArray[np.int64] = faiss.knn(own, keys, min(clusters, len(keys)))[1]
    return found


def aliases_of(cascade: Cascade, template: int, clusters: NDArray[np.int64], config: AliasConfig) -> Matches:
    """One template's aliases in the given clusters, most similar first. The same spot and heading is none."""
    found = cascade.match(cascade.templates.described_at(np.array([template])), clusters)
    kept = kept_apart(cascade, template, found.rows, found.yaw_rad, config.each)
    return Matches(found.rows[kept], found.yaw_rad[kept], found.score[kept])


def kept_apart(
    cascade: Cascade, template: int, rows: NDArray[np.integer], yaw_rad: NDArray[np.float64], most: int
) -> NDArray[np.int64]:
    """Which of (k,) matches of a template, most similar first, are one for each spot and not its own."""
    position_m = cascade.templates.position_m[np.append(template, rows)].astype(np.float64)  # its own first
    headings_rad = np.append(0.0, yaw_rad)
    chosen: NDArray[np.int64] = spread_out(position_m, headings_rad, most + 1, SPOT_M, _SPOT_COS, 1)[1:] - 1
    return chosen
