"""The ladder of effort in Python: ``native.MapSearch`` and ``native.answered`` are held against it."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import replace
from operator import attrgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firstfix.answer.localization import Localization
from firstfix.answer.options import LocalizeOptions
from firstfix.answer.prior import Prior
from firstfix.engine.candidates import Candidates
from firstfix.engine.config import EffortConfig
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer
from firstfix.engine.map_search import Step
from firstfix.engine.preprocess import PreparedQuery, PreparedScan
from firstfix.engine.registered_candidate import RegisteredCandidate
from firstfix.engine.stopwatch import Stopwatch
from firstfix.engine.verdict import threshold_of
from firstfix.engine.with_prior import judging
from tests.reference.distinct import distinct
from tests.reference.found_candidates import candidates_of_scan, find_candidates
from tests.reference.hypothesis_steps import HypothesisSteps
from tests.reference.levelled_otherwise import levelled_otherwise, with_other_ups
from tests.reference.verdict_in_steps import judge

SCREENED_PER_REGISTERED = 12  # poses that are screened in the time of one candidate's registration
COMPARED_PER_REGISTERED = 200  # templates that are compared in this time
SLOWER = 1.5  # than estimated, at worst
OTHER_UPS = 6  # at most, each with a first search of its own
BEST_TEMPLATES = 0.1  # share of the screened templates near which a scan may fit that is levelled otherwise
NEIGHBOUR_SPACINGS = 1.1  # of the templates: how near
_NO_CANDIDATES = Candidates(np.empty(0, np.int64), np.empty((0, 4, 4)), np.empty(0))


class MapSearch:
    """Search of one query in one map. Each step adds to what the steps before it registered.

    Attributes:
        registered: best first, of all steps so far.
    """

    def __init__(
        self,
        index: MapIndex,
        prepared: PreparedQuery,
        options: LocalizeOptions,
        watch: Stopwatch,
        map_id: str = "",
    ) -> None:
        self._index, self._prepared, self._options, self._watch = index, prepared, options, watch
        self._map_id = map_id
        self._hypotheses = self.new_hypotheses(options.prior)
        self._narrow_s = 0.0
        self._screened: tuple[NDArray[np.int64], NDArray[np.float64]] | None = None  # templates and scores
        self._is_ranked = True
        self.registered: list[RegisteredCandidate] = []

    def new_hypotheses(self, prior: Prior | None) -> Any:
        """A search for poses that a prior allows, which has found nothing yet."""
        return HypothesisSteps(self._index, self._prepared, prior, self._map_id)

    @property
    def is_settled(self) -> bool:
        """Whether the best pose is so surely right that nothing else is searched for."""
        self.rank()
        return self._hypotheses.is_settled

    @property
    def explains_scan(self) -> bool:
        """Whether the best pose would be accepted without its rivals, with up surely right.

        With a wrong up direction, up to two thirds of a scan may lie on surfaces that nothing contradicts.
        """
        if not self._is_ranked and not self._hypotheses.may_explain_scan:
            return False
        self.rank()
        return self._hypotheses.explains_scan

    def rank(self) -> None:
        """Rank what the steps so far have aligned."""
        if self._is_ranked:
            return
        with self._watch.stage("register"):
            nearby = self._index.config.search.widened > 1
            self.registered = self._hypotheses.run(_NO_CANDIDATES, nearby=nearby)
        self._is_ranked = True

    def answer(
        self, others: Sequence[MapSearch], options: LocalizeOptions, *, likely_one: bool = False
    ) -> Localization:
        """See ``firstfix.engine.map_search.MapSearch``."""
        searches = [self, *others]
        if not (likely_one and _one_explains_scan(searches)):
            _search(searches)
        for search in searches:
            search.try_aliases()
        with self._watch.stage("verify"):
            together = [one for search in searches for one in search.registered]
            together.sort(key=attrgetter("support"), reverse=True)
            dense = {search._map_id: search._prepared.dense for search in searches}
            return judge(together, options, dense[together[0].map_id] if together else None)

    def take(self, step: Step) -> None:
        """Search with the effort of one step, if the caller's deadline leaves time for it."""
        if self._expected_s(step) > self._watch.deadline.left_s:
            return
        search = self._index.config.search
        if step is Step.NARROW:
            began = time.monotonic()
            self._by_descriptor(self._prepared.scans)
            self._narrow_s = time.monotonic() - began
        elif step is Step.OTHER_UPS:
            with self._watch.stage("preprocess"):
                config = self._index.config.preprocess
                ups = with_other_ups(self._prepared, self._options.gravity, config)
            self._by_descriptor(ups)
        elif search.widened > 1 and self._options.max_candidates is None:
            is_last = step is Step.EXHAUSTIVE
            self._by_screening(search.exhaustive if is_last else search.wide, tilted=is_last)

    def may_fit(self, inlier_ratio: float) -> bool:
        """Yes: so every form of a scan is searched for, and answers show whether one was left out wrongly."""
        return True

    def probe(self, count: int) -> None:
        """Register the best few templates by descriptor, to see whether the scan may be of this map at all.

        The first step then adds to them.
        """
        index = self._index
        with self._watch.stage("describe"):
            described = [one.described_by(index.cascade.descriptor) for one in self._prepared.scans]
        with self._watch.stage("search"):
            few = replace(self._options, max_candidates=min(count, self._options.max_candidates or count))
            candidates = find_candidates(index, described, self._prepared.scans, few)
        with self._watch.stage("register"):
            self.registered = self._hypotheses.run(candidates)

    def try_aliases(self) -> None:
        """Let the known aliases of the best pose compete, if it would be accepted.

        Those that were not registered yet are tried if there is time for it.
        """
        index, options = self._index, self._options
        config, asked = index.config.search, threshold_of(index, options)
        if index.aliases is None or not self._hypotheses.is_accepted(asked):
            return
        expected_s = SLOWER * self._narrow_s * config.aliases.tried / config.candidates
        in_time = expected_s <= self._watch.deadline.left_s
        if in_time:
            self._watch.add(self._hypotheses.try_aliases(asked, nearby=config.widened > 1))
        self.registered = self._hypotheses.with_look_alikes_marked()
        if in_time and options.prior is not None:
            self._compare_outside()

    def _compare_outside(self) -> None:
        """Compare the best pose with places outside the prior, if an alias there fits nearly as well.

        Is the prior wrong? Those that are as good do not count: which of them is right, the prior says. One
        that is clearly better shows that the prior is wrong: the scan was taken there. Most places have no
        alias, and a prior saves the search of the whole map.
        """
        index, best, prepared = self._index, self.registered[0], self._prepared
        with self._watch.stage("aliases"):
            aliases = self._hypotheses.aliases_outside()
            if not len(aliases):
                return
            described = [one.described_by(index.cascade.descriptor) for one in prepared.scans]
            similar = find_candidates(index, described, prepared.scans, replace(self._options, prior=None))
            anywhere = self.new_hypotheses(None)
            anywhere.run(Candidates.merged([aliases, similar]), best.registration.twist)
            lead = self._hypotheses.lead_outside(anywhere)
            self.registered = [replace(best, outside_lead=lead), *self.registered[1:]]

    def _expected_s(self, step: Step) -> float:
        """Seconds that a step takes, at worst: measured by the first one, which always runs."""
        search = self._index.config.search
        if step is Step.NARROW:
            return -math.inf
        if step is Step.OTHER_UPS:
            return SLOWER * OTHER_UPS * self._narrow_s
        effort = search.exhaustive if step is Step.EXHAUSTIVE else search.wide
        registrations = (
            effort.candidates
            + effort.screened / SCREENED_PER_REGISTERED
            + effort.clusters / COMPARED_PER_REGISTERED
        )
        return SLOWER * self._narrow_s * registrations / search.candidates

    def _by_descriptor(self, levelled: Sequence[PreparedScan]) -> None:
        if not levelled:
            return
        index = self._index
        with self._watch.stage("describe"):
            described = [one.described_by(index.cascade.descriptor) for one in levelled]
        with self._watch.stage("search"):
            candidates = find_candidates(index, described, levelled, self._options)
        self._align(candidates)

    def _by_screening(self, effort: EffortConfig, *, tilted: bool) -> None:
        index, options = self._index, self._options
        with self._watch.stage("preprocess"):
            usual_height_m = index.cascade.templates.usual_height_m
            levelled = levelled_otherwise(self._prepared, self._expected_up(), usual_height_m, tilted=tilted)
        with self._watch.stage("search"):
            candidates, self._screened = screened_candidates(
                index, self._prepared, levelled, options, effort, self._screened
            )
        self._align(candidates)

    def _align(self, candidates: Candidates) -> None:
        with self._watch.stage("register"):
            self._hypotheses.align(candidates)
        self._is_ranked = False

    def _expected_up(self) -> NDArray[np.float64] | None:
        """(3,) up by the mounting, or None: gravity is known."""
        if self._options.gravity is not None:
            return None
        mounting = self._options.T_base_sensor
        return np.array([0.0, 0.0, 1.0]) if mounting is None else mounting[2, :3]


def screened_candidates(
    index: MapIndex,
    prepared: PreparedQuery,
    levelled: Sequence[PreparedScan],
    options: LocalizeOptions,
    effort: EffortConfig,
    before: tuple[NDArray[np.int64], NDArray[np.float64]] | None,
) -> tuple[Candidates, tuple[NDArray[np.int64], NDArray[np.float64]]]:
    """Distinct candidates whose poses fit the coarse map best, best first, and what was screened for them.

    The descriptor alone mistakes the place where sparse beams, occluders or a wrong up change many cells. A
    hundred points of the scan tell the places apart at a tenth of a registration's time.

    Args:
        levelled: the query's scans, each levelled in one way or several, which share the effort.
        before: templates and scores of what the step before has screened, if one has.
    """
    screened, among = effort.screened, None
    if before is not None:
        among = promising_templates(index, *before)
        screened = effort.screened * len(among) // len(index.cascade.templates)
    poses, clusters = (max(1, share // len(levelled)) for share in (screened, effort.clusters))
    descriptor = index.cascade.descriptor
    found = Candidates.merged(
        [
            candidates_of_scan(
                index, scan.described_by(descriptor), scan, options.prior, poses, clusters, None, among
            )
            for scan in levelled
        ]
    )
    found = found.at(np.argsort(found.template, kind="stable"))  # neighbours read the same part of the map
    T_level_sensor, score = index.surface.screen(prepared.sparse, found.T_level_sensor)
    best = np.argsort(-score, kind="stable")
    best = best[distinct(T_level_sensor[best], index.config.ranking, most=effort.candidates)]
    chosen = Candidates(found.template[best], T_level_sensor[best], score[best])
    return chosen, (found.template, score)


def promising_templates(
    index: MapIndex, template: NDArray[np.int64], score: NDArray[np.float64]
) -> NDArray[np.int64]:
    """Rows of templates where the best screened poses began, of those near them, and where none did.

    Args:
        template, score: (n,) of the screened poses.
    """
    position_m = index.cascade.templates.position_m
    best = np.full(len(position_m), -np.inf)
    np.maximum.at(best, template, score)
    rows = np.flatnonzero(best > -np.inf)
    order = rows[np.argsort(-best[rows], kind="stable")][: int(BEST_TEMPLATES * len(rows)) + 1]
    is_promising = best == -np.inf
    for row in order.tolist():
        near = index.cascade.tiles.within(
            position_m, position_m[row], NEIGHBOUR_SPACINGS * index.config.spacing_m
        )
        is_promising[near] = True
    return np.flatnonzero(is_promising)


def _search(searches: Sequence[MapSearch]) -> None:
    """Climbs the effort levels until a place explains the scan: most scans need the first step alone."""
    for search in searches:
        search.take(Step.NARROW)
        if not search.is_settled:
            search.take(Step.WIDE)
    for step in (Step.OTHER_UPS, Step.EXHAUSTIVE):
        if any(search.explains_scan for search in searches):
            break
        for search in searches:
            search.take(step)
    for search in searches:
        search.rank()


PROBED_TEMPLATES = 24  # templates that are registered, of all maps together
MIN_PROBED_PER_MAP = 3  # of each


def _one_explains_scan(searches: Sequence[MapSearch]) -> bool:
    """Probes all maps, and takes the first step in the best one. Returns whether its place is accepted.

    The places of the others compete with it in the answer.
    """
    for search in searches:
        search.probe(max(MIN_PROBED_PER_MAP, PROBED_TEMPLATES // len(searches)))
    found = [search for search in searches if search.registered]
    if not found:
        return False
    best = max(found, key=lambda search: search.registered[0].support)
    best.take(Step.NARROW)
    return best.is_settled


class LocalizerInSteps(Localizer):
    """A localizer whose ladder of effort is this one."""

    def search(
        self, prepared: PreparedQuery, options: LocalizeOptions, watch: Stopwatch, map_id: str = ""
    ) -> Any:
        """See ``Localizer.search``."""
        return MapSearch(judging(self.index, options), prepared, options, watch, map_id)
