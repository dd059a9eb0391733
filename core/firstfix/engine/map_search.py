"""Search of one query in one map or several (docs/method.md section 7.1).

The ladder of effort and the verdict are compiled: ``native/include/firstfix/query/climb.hpp`` and
``answered.hpp``. They run without the interpreter's lock, which only a retrieval that is not compiled takes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import native
from ..answer.localization import Localization
from ..answer.options import LocalizeOptions
from .candidates import prior_numbers
from .index import MapIndex
from .preprocess import PreparedQuery
from .registered_candidate import RegisteredCandidate
from .retrieval.cascade import Cascade, FoundTemplates
from .stopwatch import Stopwatch
from .verdict import answer_of, threshold_of

Step = native.Step  # effort levels, cheapest first


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
        self._index, self._prepared, self._watch, self._map_id = index, prepared, watch, map_id
        retrieval = index.cascade.compiled
        self._compiled = native.MapSearch(
            index.searched,
            _describing(index.cascade, prepared) if retrieval is None else retrieval,
            prepared.compiled,
            None if options.prior is None else prior_numbers(options.prior, index),
            options.max_candidates,
            threshold_of(index, options, map_id),
            watch.deadline.left_s,
            watch.deadline.cancellation,
        )

    @property
    def registered(self) -> list[RegisteredCandidate]:
        """Distinct poses that the prior allows, best first, of all steps so far."""
        poses, lead = self._compiled.found(), self._compiled.outside_lead
        found = RegisteredCandidate.found(self._index, self._map_id, self._prepared.compiled.spots, poses)
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

    def answer(
        self, others: Sequence[MapSearch], options: LocalizeOptions, *, likely_one: bool = False
    ) -> Localization:
        """Climb the effort levels until a place explains the scan, let known aliases compete, and judge.

        Args:
            others: searches of the same query in other maps, whose places compete with those of this one.
            options: those of the query.
            likely_one: the maps were chosen because each resembles the scan, and at most one of them is
                right. If one explains the scan clearly, the others are only looked at.
        """
        compiled, map_ids = [self._compiled], [self._map_id]
        for other in others:
            compiled.append(other._compiled)
            map_ids.append(other._map_id)
        reason, probability, places, placed, stages = native.answered(
            compiled, likely_one, options.T_base_sensor
        )
        self._watch.add(stages)
        return answer_of(reason, probability, places, placed, map_ids, options.twist)


def _describing(cascade: Cascade, prepared: PreparedQuery) -> Callable[..., Any]:
    """How a retrieval that is not compiled describes a scan, by its number and levelling."""

    def describe(
        number: int, R_level_sensor: NDArray[np.float64], height_m: float, is_as_measured: bool
    ) -> Callable[..., FoundTemplates]:
        scan = prepared.scans[number]
        if not is_as_measured:
            scan = replace(scan, R_level_sensor=R_level_sensor, height_m=height_m, described=None)
        return cascade.finder(scan.described_by(cascade.descriptor))

    return describe
