"""Search of one query in one map or several (docs/method.md section 7.1).

The ladder of effort is compiled: ``native/include/firstfix/query/map_search.hpp`` and ``climb.hpp``. It runs
without the interpreter's lock, which only a retrieval that is not compiled takes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import native
from ..answer.options import LocalizeOptions
from .candidates import prior_numbers
from .hypotheses import surface_numbers, viewed
from .index import MapIndex
from .preprocess import PreparedQuery, PreparedScan, spots_of
from .registered_candidate import RegisteredCandidate
from .retrieval.cascade import Cascade, FoundTemplates
from .stopwatch import Stopwatch
from .verdict import threshold_of

Step = native.Step  # effort levels, cheapest first

_UPRIGHT = np.array([0.0, 0.0, 1.0])


class MapSearch:
    """Search of one query in one map. Each step adds to what the steps before it registered.

    Not thread-safe.
    """

    def __init__(
        self,
        index: MapIndex,
        prepared: PreparedQuery,
        options: LocalizeOptions,
        watch: Stopwatch,
        map_id: str = "",
    ) -> None:
        self._index, self._watch, self._map_id = index, watch, map_id
        self._spots = spots_of(prepared.scans, index.config.ranking.spots_apart_m)
        mounting, retrieval = options.T_base_sensor, index.cascade.compiled
        scans = prepared.scans
        self._compiled = native.MapSearch(
            index.searched,
            _describing(index.cascade, scans) if retrieval is None else retrieval,
            list(map(viewed, scans)),
            [_to_describe(scan, index) for scan in scans],
            surface_numbers(prepared.dense),
            surface_numbers(prepared.sparse),
            self._spots,
            None if options.prior is None else prior_numbers(options.prior, index),
            options.gravity,
            _UPRIGHT if mounting is None else mounting[2, :3],
            options.max_candidates,
            threshold_of(index, options, map_id),
            watch.left_s,
        )

    @property
    def registered(self) -> list[RegisteredCandidate]:
        """Distinct poses that the prior allows, best first, of all steps so far."""
        poses, lead = self._compiled.found(), self._compiled.outside_lead
        found = RegisteredCandidate.found(self._index, self._map_id, self._spots, poses)
        if found and lead:
            found[0] = replace(found[0], outside_lead=lead)
        return found

    @property
    def is_settled(self) -> bool:
        """Whether the best pose is so surely right that nothing else is searched for."""
        return self._compiled.is_settled()

    @property
    def taken(self) -> list[Step]:
        """Steps that were taken, in order."""
        return self._compiled.taken

    def take(self, step: Step) -> None:
        """Search with the effort of one step, if the caller's deadline leaves time for it."""
        self._watch.add(self._compiled.take(step))

    def may_fit(self, inlier_ratio: float) -> bool:
        """Whether more than a share of the scan lies on the map at a place that the first step would find.

        It costs a third of the step, or less, where the scan fits nowhere.
        """
        return self._compiled.may_fit(inlier_ratio)

    def climb(self, others: Sequence[MapSearch] = (), *, likely_one: bool = False) -> None:
        """Climb the effort levels until a place explains the scan, then let known aliases compete.

        Args:
            others: searches of the same query in other maps, whose places compete with those of this one.
            likely_one: the maps were chosen because each resembles the scan, and at most one of them is
                right. If one explains the scan clearly, the others are only looked at.
        """
        compiled = [self._compiled]
        for other in others:
            compiled.append(other._compiled)
        self._watch.add(native.search_maps(compiled, likely_one))


def _to_describe(scan: PreparedScan, index: MapIndex) -> tuple[Any, ...]:
    known, descriptor = scan.described, index.cascade.descriptor
    occupancy = None
    if known is not None and known.agrees_with(descriptor):  # the robot had all points
        occupancy = known.occupancy
    thinned = scan.thinned
    return (scan.R_level_sensor, scan.height_m), scan.seen, occupancy, thinned.points, thinned.normals


def _describing(cascade: Cascade, scans: Sequence[PreparedScan]) -> Callable[..., Any]:
    """How a retrieval that is not compiled describes a scan, by its number and levelling."""

    def describe(
        number: int, R_level_sensor: NDArray[np.float64], height_m: float, is_as_measured: bool
    ) -> Callable[..., FoundTemplates]:
        scan = scans[number]
        if not is_as_measured:
            scan = replace(scan, R_level_sensor=R_level_sensor, height_m=height_m, described=None)
        return cascade.finder(scan.described_by(cascade.descriptor))

    return describe
