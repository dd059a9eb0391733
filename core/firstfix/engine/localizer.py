"""The query flow: one scan in, one answer out. Each stage is one named call."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import replace
from operator import attrgetter
from typing import Protocol

from ..answer.localization import Localization, Reason, Verdict
from ..answer.options import LocalizeOptions
from ..errors import InvalidOption
from ..scan.compact import CompactScan, ScanDescriptor
from ..scan.scan import Scan
from ..scan.sequence import AnyScan, ScanSequence
from .config import PreprocessConfig
from .deadline import Deadline
from .descriptor_only import UnregisteredCandidate, answer_unregistered, find_unregistered
from .diagnosis.diagnose import AskedQuery, diagnosed
from .diagnosis.place_findings import reasons_found
from .hint.find import find_hint
from .index import MapIndex
from .map_search import MapSearch, Step
from .preprocess import PreparedQuery, preprocess
from .ranking import RankingConfig
from .stopwatch import Stopwatch
from .verdict import threshold_of
from .with_prior import judging


class SearchesMap(Protocol):
    """The part of a ``Localizer`` that ``localize_among`` needs."""

    index: MapIndex

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
    """Answers queries against one map version. Thread-safe.

    Args:
        explains: a scan that does not fit as it was sent is tried in other forms, to say why.
    """

    def __init__(self, index: MapIndex, *, explains: bool = True) -> None:
        self.index, self._explains = index, explains

    def localize(
        self, scan: AnyScan, options: LocalizeOptions | None = None, deadline: Deadline | float | None = None
    ) -> Localization:
        """The sensor's pose in the map at the last scan, or the reason why there is none.

        Args:
            deadline: a time of ``time.monotonic``, inf: none; None: ``deadline_ms`` of the options from now.
                A ``Deadline`` can also be cancelled, by another thread or process.

        Raises:
            QueryCancelled: the deadline was cancelled. It leaves nothing behind for the next query.
        """
        return localize_among({"": self}, scan, options, deadline, explains=self._explains)

    def prepare(
        self, sequence: ScanSequence, options: LocalizeOptions, watch: Stopwatch, map_id: str = ""
    ) -> PreparedQuery | None:
        """Preprocesses the scans. Returns None if too few points are left.

        Raises:
            InvalidOption: this map cannot keep the caller's ``max_false_accept``, or a twist was given and
                the times of the points are not known.
        """
        threshold_of(self.index, options, map_id)
        mounting = options.T_base_sensor
        R_base_sensor = None if mounting is None else mounting[:3, :3]
        with watch.stage("preprocess"):
            config = self.index.config
            return preprocess(
                sequence, options.gravity, config.preprocess, R_base_sensor, config.ranking, options.twist
            )

    def search(
        self, prepared: PreparedQuery, options: LocalizeOptions, watch: Stopwatch, map_id: str = ""
    ) -> MapSearch:
        """Search of this map, by steps.

        Args:
            prepared: by this localizer's ``prepare``.
        """
        return MapSearch(judging(self.index, options), prepared, options, watch, map_id)

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
    deadline: Deadline | float | None = None,
    *,
    explains: bool = True,
    likely_one: bool = False,
) -> Localization:
    """Localize a scan in several maps, whose candidates compete on equal terms.

    Args:
        maps: by id. The answer's ``map_id`` names the map whose frame the pose is in.
        deadline: as for ``Localizer.localize``.
        explains: as for ``Localizer``.
        likely_one: the maps were chosen because each resembles the scan, and at most one of them is right. If
            one explains the scan clearly, the others are only looked at.

    Raises:
        InvalidOption: a prior or a version was given for more than one map, or a map cannot keep
            ``max_false_accept``.
        InvalidOption: a twist was given, and the times of the points are not known.
        DescriptorMismatch: a descriptor-only query whose parameters are not those of every map.
        QueryCancelled: as ``Localizer.localize``.
    """
    began, options = time.monotonic(), options or LocalizeOptions()
    at = options.deadline_from(began) if deadline is None else deadline
    watch = Stopwatch(at if isinstance(at, Deadline) else Deadline(at))
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
        answer = answer_unregistered(found)
        return replace(answer, findings=reasons_found(answer), timings_ms=watch.ms)
    sequence = ScanSequence.single(scan) if isinstance(scan, (Scan, CompactScan)) else scan
    prepared = _prepared(maps, sequence, options, watch)
    answer = _answer_of(maps, prepared, options, watch, likely_one) if prepared else _TOO_FEW
    with watch.stage("diagnose"):
        map_id = answer.hypotheses[0].map_id if answer.hypotheses else next(iter(prepared or maps))
        query = _asked(sequence, options, maps[map_id], prepared.get(map_id), map_id, watch, began)
        return diagnosed(answer, query, watch, explains=explains)


_TOO_FEW = Localization(Verdict.REJECTED, (Reason.TOO_FEW_POINTS,))


def _prepared(
    maps: Mapping[str, SearchesMap], sequence: ScanSequence, options: LocalizeOptions, watch: Stopwatch
) -> dict[str, PreparedQuery]:
    """The query as each map needs it, without maps for which too few points are left.

    Maps of equal parameters share it.
    """
    if len(maps) == 1:
        ((map_id, one),) = maps.items()
        query = one.prepare(sequence, options, watch, map_id)
        return {} if query is None else {map_id: query}
    made: dict[tuple[PreprocessConfig, RankingConfig], PreparedQuery | None] = {}
    prepared = {}
    for map_id, each in maps.items():
        key = each.index.config.preprocess, each.index.config.ranking
        if key in made:
            threshold_of(each.index, options, map_id)  # a map may refuse the option
        else:
            made[key] = each.prepare(sequence, options, watch, map_id)
        query = made[key]
        if query is not None:
            prepared[map_id] = query
    return prepared


def _answer_of(
    maps: Mapping[str, SearchesMap],
    prepared: Mapping[str, PreparedQuery],
    options: LocalizeOptions,
    watch: Stopwatch,
    likely_one: bool,
) -> Localization:
    """Search the maps for which the query could be prepared, and judge what was found."""
    searches = [maps[map_id].search(query, options, watch, map_id) for map_id, query in prepared.items()]
    answer = searches[0].answer(searches[1:], options, likely_one=likely_one)
    if answer.verdict is Verdict.AMBIGUOUS:
        with watch.stage("hint"):
            together = [one for search in searches for one in search.registered]
            together.sort(key=attrgetter("support"), reverse=True)
            probability = [hypothesis.probability for hypothesis in answer.hypotheses]
            answer = replace(answer, hint=find_hint(prepared[together[0].map_id], together, probability))
    return answer


def _asked(
    sequence: ScanSequence,
    options: LocalizeOptions,
    one_map: SearchesMap,
    prepared: PreparedQuery | None,
    map_id: str,
    watch: Stopwatch,
    began: float,
) -> AskedQuery:
    """The query as one map was asked, and how to ask it for another scan."""

    def asked(scan: Scan, others: LocalizeOptions, least_ratio: float) -> MapSearch | None:
        apart = Stopwatch(watch.deadline)
        again = one_map.prepare(ScanSequence.single(scan), others, apart, map_id)
        if again is None:
            return None
        search = one_map.search(again, others, apart, map_id)
        return search if search.may_fit(least_ratio) else None

    def may_fit(scan: Scan, others: LocalizeOptions, least_ratio: float) -> bool:
        return asked(scan, others, least_ratio) is not None

    def ask(scan: Scan, others: LocalizeOptions, least_ratio: float) -> MapSearch | None:
        search = asked(scan, others, least_ratio)
        if search is not None:
            search.take(Step.NARROW)
        return search

    return AskedQuery(
        sequence.scans[-1],
        len(sequence.scans) == 1,
        options,
        prepared,
        one_map.index.config.preprocess,
        one_map.index.cascade.templates.usual_height_m,
        may_fit,
        ask,
        began,
    )
