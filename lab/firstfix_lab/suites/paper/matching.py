"""The cascade of the tables: the share of queries whose best template is near, and the time of one thread."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from firstfix.descriptor import Described, rows_of
from firstfix.descriptor.pca_sc import PcaScanContext
from firstfix.descriptor.similarity import Columns, similarity
from firstfix.engine.config import SearchConfig
from firstfix.engine.retrieval.cascade import Cascade, Clusters, Templates
from firstfix.engine.retrieval.template_tiles import TemplateTiles

from ...common.other_key_searches import build_search
from .published import WITHIN_M
from .scene import DESCRIPTORS, Taken

ROWS = 1024  # queries compared at once
ON_THE_EDGE_M = 1e-3  # neighbours on the grid are 0.2 m apart: that is within 0.2 m


def success(found_m: NDArray[np.floating], true_m: NDArray[np.floating]) -> list[float]:
    """Share of (n, 3) places that lie within each of WITHIN_M of the true ones."""
    error = np.linalg.norm(found_m - true_m, axis=1)
    return [round(float(np.mean(error <= limit + ON_THE_EDGE_M)), 5) for limit in WITHIN_M]


def one_by_one(described: Described) -> Iterator[Described]:
    """Every scan alone, as a query is."""
    for row in range(len(next(iter(described.values())))):
        yield rows_of(described, slice(row, row + 1))


class Timed:
    """Mean milliseconds of all threads' processor time: what one thread alone would take."""

    def __init__(self) -> None:
        self._total_s, self._count = 0.0, 0

    def __call__(self, work: Callable[[], NDArray[np.integer]]) -> NDArray[np.integer]:
        begin = time.process_time()
        result = work()
        self._total_s += time.process_time() - begin
        self._count += 1
        return result

    @property
    def ms(self) -> float:
        return round(1e3 * self._total_s / max(1, self._count), 4)


def make_cascade(
    templates: Taken, clusters: Clusters, config: SearchConfig, name: str, engine: str | None = None
) -> Cascade:
    """The cascade with the config's key search, or one of another name."""
    how, described = DESCRIPTORS[name], templates.by[name]
    keys = build_search(
        engine or config.engine, how.keys(rows_of(described, clusters.representative)), config
    )
    height_m = np.zeros(len(templates), np.float32)
    tiles = TemplateTiles.of(templates.position_m)
    return Cascade(how, Templates(templates.position_m, height_m, described), tiles, clusters, keys)


@dataclass(frozen=True)
class CascadeRun:
    """Answers and times of one run of the cascade.

    Attributes:
        found: (n,) best template of each query.
    """

    found: NDArray[np.int64]
    search_ms: float
    match_ms: float


def run_cascade(cascade: Cascade, queries: Described, clusters: int) -> CascadeRun:
    """Every query alone, on one thread."""
    search, match = Timed(), Timed()
    found = []
    for query in one_by_one(queries):
        nearest = search(lambda query=query: cascade.nearest(query, clusters))
        found.append(match(lambda query=query, nearest=nearest: cascade.match(query, nearest).rows[:1])[0])
    return CascadeRun(np.array(found), search.ms, match.ms)


class ContextSearch:
    """All contexts compared (equations 4 and 6): the paper's matching without any acceleration."""

    def __init__(self, how: PcaScanContext, described: Described) -> None:
        self._how, self._columns = how, Columns.of(described["context"])

    def nearest(self, queries: Described, count: int) -> NDArray[np.int64]:
        """(n, count) rows, the most alike first."""
        trusted = queries["ratio"] < self._how.max_ratio
        few = np.arange(-self._how.trusted_shifts, self._how.trusted_shifts + 1)
        found = np.empty((len(trusted), count), np.int64)
        for rows, shifts in (
            (np.flatnonzero(trusted), few),
            (np.flatnonzero(~trusted), np.arange(self._how.grid.sectors)),
        ):
            for start in range(0, len(rows), ROWS):
                block = rows[start : start + ROWS]
                alike = self._alike(queries["context"][block], shifts)
                best = np.argpartition(-alike, count - 1, axis=1)[:, :count]
                order = np.argsort(-np.take_along_axis(alike, best, axis=1), axis=1, kind="stable")
                found[block] = np.take_along_axis(best, order, axis=1)
        return found

    def _alike(self, context: NDArray[np.floating], shifts: NDArray[np.integer]) -> NDArray[np.float32]:
        best = similarity(Columns.of(np.roll(context, shifts[0], axis=2)), self._columns)
        for shift in shifts[1:]:
            turned = Columns.of(np.roll(context, shift, axis=2))
            np.maximum(best, similarity(turned, self._columns), out=best)
        return best
