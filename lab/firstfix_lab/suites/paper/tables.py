"""Tables II to V, and the same rows with held-out, perturbed queries."""

from __future__ import annotations

import sys
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firstfix.descriptor import Described, rows_of
from firstfix.descriptor.pca_sc import PcaScanContext
from firstfix.engine.config import SearchConfig

from .clusterings import Clusterer, Clustering
from .matching import ContextSearch, Timed, make_cascade, one_by_one, run_cascade, success
from .scene import DESCRIPTORS, PAPER, Scene, Taken

Row = dict[str, Any]
K = 10  # the paper's number of KNN candidates
TIMED_QUERIES = 50


def table_2(
    scene: Scene, clusterer: Clusterer, own: Taken, perturbed: Taken, thresholds: tuple[float, ...]
) -> list[Row]:
    """All representatives compared by context, then the clusters of the best K; with and without KNN."""
    rows = [_row_2(scene, c, own, perturbed) for c in clusterer.without(thresholds)]
    return rows + [_row_2(scene, clusterer.with_neighbours(t), own, perturbed) for t in thresholds]


def _row_2(scene: Scene, clustering: Clustering, own: Taken, perturbed: Taken) -> Row:
    clusters = clustering.clusters
    cascade = make_cascade(scene.templates, clusters, SearchConfig(engine="exhaustive"), PAPER)
    representatives = rows_of(scene.templates.by[PAPER], clusters.representative)

    def found(described: Described, search: ContextSearch) -> NDArray[np.integer]:
        nearest = search.nearest(described, min(K, len(clusters)))
        each = zip(one_by_one(described), nearest, strict=True)
        return np.array([cascade.match(query, near).rows[0] for query, near in each])

    # a template's own axis is exact: one comparison a pair (n = 1), as the paper's 1.02 ms a pair say
    direct = partial(found, search=_context_search(representatives, trusted_shifts=0, max_ratio=np.inf))
    shifted = partial(found, search=_context_search(representatives))
    return _printed(
        "table 2",
        {
            "constraint": clustering.constraint,
            "threshold": clustering.threshold,
            "similarity_s_per_scene": round(clustering.similarity_s / len(scene.templates), 6),
            "clustering_s": round(clustering.linkage_s + clustering.choice_s, 1),
            "clusters": len(clusters),
            "match_s": _alone_s(direct, own.by[PAPER]),
            "success": _success(scene, direct(own.by[PAPER]), own),
            "success_perturbed": _success(scene, shifted(perturbed.by[PAPER]), perturbed),
        },
    )


def table_3(scene: Scene, scenes: int, perturbed: Taken) -> list[Row]:
    """Trajectory points and re-sampled points against each other, all contexts compared.

    Args:
        scenes: at most so many re-sampled queries are drawn of the half that are not templates.
    """
    rng = np.random.default_rng(3)
    count = len(scene.templates)
    shuffled = rng.permutation(count)
    half, rest = np.sort(shuffled[: count // 2]), np.sort(shuffled[count // 2 :][:scenes])
    some = np.sort(rng.permutation(count)[:scenes])
    templates, trajectory = scene.templates, scene.trajectory
    cases = (
        ("resampled", "resampled", templates.subset(rest), templates.subset(half)),
        ("resampled", "trajectory", templates.subset(some), trajectory),
        ("trajectory", "resampled", trajectory, templates),
    )
    rows = []
    for asked, known, queries, among in cases:
        search = _context_search(among.by[PAPER])

        def found(described: Described, search: ContextSearch = search) -> NDArray[np.integer]:
            return search.nearest(described, 1)[:, 0]

        row = {
            "scenes": asked,
            "templates": known,
            "number_of_scenes": len(queries),
            "number_of_templates": len(among),
            "match_s": _alone_s(found, queries.by[PAPER]),
            "success": success(among.position_m[found(queries.by[PAPER])], queries.position_m),
        }
        if asked == "resampled":
            row["success_perturbed"] = success(
                among.position_m[found(perturbed.by[PAPER])], perturbed.position_m
            )
        rows.append(_printed("table 3", row))
    return rows


def cascade_table(
    name: str,
    scene: Scene,
    clusterings: list[Clustering],
    config: SearchConfig,
    own: Taken,
    perturbed: Taken,
) -> list[Row]:
    """Tables IV and V: candidates by CNZ key, then the clusters of the best K matched."""
    rows = []
    for clustering in clusterings:
        cascade = make_cascade(scene.templates, clustering.clusters, config, PAPER)
        run = run_cascade(cascade, own.by[PAPER], K)
        again = run_cascade(cascade, perturbed.by[PAPER], K)
        row = {
            "threshold": clustering.threshold,
            "clusters": len(clustering.clusters),
            "search_ms": run.search_ms,
            "match_ms": run.match_ms,
            "success": _success(scene, run.found, own),
            "success_perturbed": _success(scene, again.found, perturbed),
        }
        rows.append(_printed(name, row))
    return rows


def _context_search(described: Described, **changes: float) -> ContextSearch:
    how = DESCRIPTORS[PAPER]
    assert isinstance(how, PcaScanContext)
    return ContextSearch(replace(how, **changes), described)


def _success(scene: Scene, found: NDArray[np.integer], queries: Taken) -> list[float]:
    return success(scene.templates.position_m[found], queries.position_m)


def _alone_s(found: Any, described: Described) -> float:
    """One thread's seconds for one query, asked alone."""
    timed = Timed()
    count = len(next(iter(described.values())))
    for row in np.linspace(0, count - 1, min(count, TIMED_QUERIES)).astype(int):
        one = rows_of(described, slice(row, row + 1))
        timed(lambda one=one: found(one))
    return round(timed.ms / 1e3, 6)


def _printed(table: str, row: Row) -> Row:
    print(table, row, file=sys.stderr, flush=True)
    return row
