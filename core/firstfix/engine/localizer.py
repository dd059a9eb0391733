"""The query flow: one scan in, one answer out. Each stage is one named call."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Protocol

from ..answer.localization import Localization, Reason, Verdict
from ..answer.options import LocalizeOptions
from ..answer.quality import MAX_MARGIN
from ..errors import InvalidOption
from ..scan.compact import CompactScan, ScanDescriptor
from ..scan.scan import Scan
from ..scan.sequence import AnyScan, ScanSequence
from .candidates import find_candidates
from .descriptor_only import UnregisteredCandidate, answer_unregistered, find_unregistered
from .hint.find import find_hint
from .hypotheses import HypothesisSearch
from .index import MapIndex
from .preprocess import PreparedQuery, preprocess
from .registered_candidate import RegisteredCandidate, features_of, ranked
from .stopwatch import Stopwatch
from .verdict import judge

CONVINCING_INLIER_RATIO = 0.75  # below it the other up directions are tried too, however probable the fix is


class SearchesMap(Protocol):
    """The part of a ``Localizer`` that ``localize_among`` needs."""

    def prepare(
        self, sequence: ScanSequence, options: LocalizeOptions, watch: Stopwatch
    ) -> PreparedQuery | None:
        """See ``Localizer.prepare``."""
        ...

    def register(
        self,
        prepared: PreparedQuery,
        options: LocalizeOptions,
        watch: Stopwatch,
        map_id: str = "",
        other_ups: bool = False,
    ) -> list[RegisteredCandidate]:
        """See ``Localizer.register``."""
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

    def localize(self, scan: AnyScan, options: LocalizeOptions | None = None) -> Localization:
        """Returns the sensor's pose in the map at the last scan, or the reason why there is none."""
        return localize_among({"": self}, scan, options)

    def prepare(
        self, sequence: ScanSequence, options: LocalizeOptions, watch: Stopwatch
    ) -> PreparedQuery | None:
        """Preprocesses the scans. Returns None if too few points are left."""
        mounting = options.T_base_sensor
        R_base_sensor = None if mounting is None else mounting[:3, :3]
        with watch.stage("preprocess"):
            return preprocess(sequence, options.gravity, self.index.config.preprocess, R_base_sensor)

    def register(
        self,
        prepared: PreparedQuery,
        options: LocalizeOptions,
        watch: Stopwatch,
        map_id: str = "",
        other_ups: bool = False,
    ) -> list[RegisteredCandidate]:
        """Registered candidates in this map, best first.

        Args:
            prepared: by this localizer's ``prepare``.
            other_ups: level the scans by the other directions that may be up, not by the likeliest one.
        """
        index = self.index
        with watch.stage("preprocess"):
            scans = prepared.scans
            if other_ups:
                scans = prepared.with_other_ups(options.gravity, index.config.preprocess)
        with watch.stage("describe"):
            described = [one.described_by(index.cascade.descriptor) for one in scans]
        search = HypothesisSearch(index, prepared, options.prior, map_id)
        registered: list[RegisteredCandidate] = []
        for effort in (1,) if other_ups else self._efforts(options):
            with watch.stage("search"):
                candidates = find_candidates(index, described, scans, options, effort)
            with watch.stage("register"):
                registered = search.run(candidates)
            if registered and index.calibration.accepts(features_of(registered)):
                break
        return registered

    def unregistered(
        self, scan: ScanDescriptor, options: LocalizeOptions, watch: Stopwatch, map_id: str = ""
    ) -> list[UnregisteredCandidate]:
        """Candidate poses for a descriptor-only query, best first."""
        with watch.stage("search"):
            return find_unregistered(self.index, scan, options, map_id)

    def _efforts(self, options: LocalizeOptions) -> Iterable[int]:
        """Widths of the searches to try. One scan in ten is hard and worth a search several times as wide."""
        widened = self.index.config.search.widened
        return (1,) if widened == 1 or options.max_candidates is not None else (1, widened)


def localize_among(
    maps: Mapping[str, SearchesMap], scan: AnyScan, options: LocalizeOptions | None = None
) -> Localization:
    """Localizes a scan in several maps, whose candidates compete on equal terms.

    Args:
        maps: by id. The answer's ``map_id`` names the map whose frame the pose is in.

    Raises:
        InvalidOption: a prior or a version was given for more than one map.
        DescriptorMismatch: a descriptor-only query whose parameters are not those of every map.
    """
    options, watch = options or LocalizeOptions(), Stopwatch()
    if len(maps) > 1 and (options.prior is not None or options.version is not None):
        raise InvalidOption("a prior and a version belong to one map: name it")
    if isinstance(scan, ScanDescriptor):
        found = [
            one for map_id, each in maps.items() for one in each.unregistered(scan, options, watch, map_id)
        ]
        return replace(answer_unregistered(found), timings_ms=watch.ms)
    sequence = ScanSequence.single(scan) if isinstance(scan, (Scan, CompactScan)) else scan
    queries = {map_id: each.prepare(sequence, options, watch) for map_id, each in maps.items()}
    prepared = {map_id: query for map_id, query in queries.items() if query is not None}
    if not prepared:
        return Localization(Verdict.REJECTED, (Reason.TOO_FEW_POINTS,), timings_ms=watch.ms)
    registered = {
        map_id: maps[map_id].register(query, options, watch, map_id) for map_id, query in prepared.items()
    }
    if not any(_explain_scan(of_map) for of_map in registered.values() if of_map):
        for map_id, query in prepared.items():
            others = maps[map_id].register(query, options, watch, map_id, other_ups=True)
            registered[map_id] = ranked([*registered[map_id], *others])
    with watch.stage("verify"):
        together = [candidate for of_map in registered.values() for candidate in of_map]
        together.sort(key=lambda candidate: -candidate.quality.support)
        answer = judge(together, options)
    if answer.verdict is Verdict.AMBIGUOUS:
        with watch.stage("hint"):
            probability = [hypothesis.probability for hypothesis in answer.hypotheses]
            answer = replace(answer, hint=find_hint(prepared[together[0].map_id], together, probability))
    return replace(answer, timings_ms=watch.ms)


def _explain_scan(registered: Sequence[RegisteredCandidate]) -> bool:
    """Returns whether the best candidate would be accepted without its rivals, with up surely right.

    With a wrong up direction, up to two thirds of a scan may lie on surfaces that nothing contradicts.
    """
    best = features_of(registered)
    alone = replace(best, margin=MAX_MARGIN, tied=1)
    is_convincing = best.quality.inlier_ratio >= CONVINCING_INLIER_RATIO
    return is_convincing and registered[0].index.calibration.accepts(alone)
