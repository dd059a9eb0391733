"""The query flow: one scan in, one answer out. Each stage is one named call."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Protocol

from ..answer.localization import Localization, Reason, Verdict
from ..answer.options import LocalizeOptions
from ..errors import InvalidOption
from ..scan.compact import CompactScan, ScanDescriptor
from ..scan.scan import Scan
from ..scan.sequence import AnyScan, ScanSequence
from .descriptor_only import UnregisteredCandidate, answer_unregistered, find_unregistered
from .hint.find import find_hint
from .hypotheses import RegisteredCandidate, features_of
from .index import MapIndex
from .map_search import MapSearch, Step
from .preprocess import PreparedQuery, deskewed, preprocess
from .stopwatch import Stopwatch
from .verdict import judge, threshold_of


class SearchesMap(Protocol):
    """The part of a ``Localizer`` that ``localize_among`` needs."""

    def prepare(
        self, sequence: ScanSequence, options: LocalizeOptions, watch: Stopwatch, map_id: str = ""
    ) -> PreparedQuery | None:
        """See ``Localizer.prepare``."""
        ...

    def search(
        self, prepared: PreparedQuery, options: LocalizeOptions, watch: Stopwatch, map_id: str = ""
    ) -> MapSearch:
        """See ``Localizer.search``."""
        ...

    def unregistered(
        self, scan: ScanDescriptor, options: LocalizeOptions, watch: Stopwatch, map_id: str = ""
    ) -> list[UnregisteredCandidate]:
        """See ``Localizer.unregistered``."""
        ...


class Localizer:
    """Answers queries against one map version. Thread-safe."""

    def __init__(self, index: MapIndex) -> None:
        self.index = index

    def localize(
        self, scan: AnyScan, options: LocalizeOptions | None = None, deadline: float | None = None
    ) -> Localization:
        """Returns the sensor's pose in the map at the last scan, or the reason why there is none.

        Args:
            deadline: of ``time.monotonic``, inf: none; None: ``deadline_ms`` of the options from now.
        """
        return localize_among({"": self}, scan, options, deadline)

    def prepare(
        self, sequence: ScanSequence, options: LocalizeOptions, watch: Stopwatch, map_id: str = ""
    ) -> PreparedQuery | None:
        """Preprocesses the scans. Returns None if too few points are left.

        Raises:
            InvalidOption: this map cannot keep the caller's ``max_false_accept``.
        """
        threshold_of(self.index, options, map_id)
        mounting = options.T_base_sensor
        R_base_sensor = None if mounting is None else mounting[:3, :3]
        with watch.stage("preprocess"):
            config = self.index.config.preprocess
            return preprocess(
                deskewed(sequence, options.twist),
                options.gravity,
                config,
                R_base_sensor,
                self.index.config.ranking,
            )

    def search(
        self, prepared: PreparedQuery, options: LocalizeOptions, watch: Stopwatch, map_id: str = ""
    ) -> MapSearch:
        """Search of this map, by steps.

        Args:
            prepared: by this localizer's ``prepare``.
        """
        return MapSearch(self.index, prepared, options, watch, map_id)

    def unregistered(
        self, scan: ScanDescriptor, options: LocalizeOptions, watch: Stopwatch, map_id: str = ""
    ) -> list[UnregisteredCandidate]:
        """Candidate poses for a descriptor-only query, best first."""
        with watch.stage("search"):
            return find_unregistered(self.index, scan, options, map_id)


def localize_among(
    maps: Mapping[str, SearchesMap],
    scan: AnyScan,
    options: LocalizeOptions | None = None,
    deadline: float | None = None,
) -> Localization:
    """Localizes a scan in several maps, whose candidates compete on equal terms.

    Args:
        maps: by id. The answer's ``map_id`` names the map whose frame the pose is in.
        deadline: as for ``Localizer.localize``.

    Raises:
        InvalidOption: a prior or a version was given for more than one map, or a map cannot keep
            ``max_false_accept``.
        InvalidOption: a twist was given, and the times of the points are not known.
        DescriptorMismatch: a descriptor-only query whose parameters are not those of every map.
    """
    options = options or LocalizeOptions()
    watch = Stopwatch(options.deadline_from(time.monotonic()) if deadline is None else deadline)
    if len(maps) > 1 and (options.prior is not None or options.version is not None):
        raise InvalidOption("a prior and a version belong to one map: name it")
    if isinstance(scan, ScanDescriptor):
        if options.twist is not None:
            raise InvalidOption(
                "a twist needs the times of the scan's points, and a descriptor has no points"
            )
        found = [
            one for map_id, each in maps.items() for one in each.unregistered(scan, options, watch, map_id)
        ]
        return replace(answer_unregistered(found), timings_ms=watch.ms)
    sequence = ScanSequence.single(scan) if isinstance(scan, (Scan, CompactScan)) else scan
    queries = {map_id: each.prepare(sequence, options, watch, map_id) for map_id, each in maps.items()}
    prepared = {map_id: query for map_id, query in queries.items() if query is not None}
    if not prepared:
        return Localization(Verdict.REJECTED, (Reason.TOO_FEW_POINTS,), timings_ms=watch.ms)
    searches = [maps[map_id].search(query, options, watch, map_id) for map_id, query in prepared.items()]
    _search(searches)
    with watch.stage("verify"):
        together = [candidate for search in searches for candidate in search.registered]
        together.sort(key=lambda candidate: -candidate.support)
        answer = judge(together, options)
    if answer.verdict is Verdict.AMBIGUOUS:
        with watch.stage("hint"):
            probability = [hypothesis.probability for hypothesis in answer.hypotheses]
            answer = replace(answer, hint=find_hint(prepared[together[0].map_id], together, probability))
    return replace(answer, timings_ms=watch.ms)


def _search(searches: Sequence[MapSearch]) -> None:
    """Climbs the effort levels until a place explains the scan: most scans need the first step alone."""
    for search in searches:
        search.take(Step.NARROW)
        if not search.is_accepted:
            search.take(Step.WIDE)
    for step in (Step.OTHER_UPS, Step.EXHAUSTIVE):
        if any(_explain_scan(search.registered) for search in searches if search.registered):
            return
        for search in searches:
            search.take(step)


def _explain_scan(registered: Sequence[RegisteredCandidate]) -> bool:
    """Returns whether the best candidate would be accepted without its rivals, with up surely right.

    With a wrong up direction, up to two thirds of a scan may lie on surfaces that nothing contradicts.
    """
    best = features_of(registered)
    is_convincing = best.quality.inlier_ratio >= best.ranking.convincing_inlier_ratio
    return is_convincing and registered[0].index.calibration.accepts(best.without_rivals)
