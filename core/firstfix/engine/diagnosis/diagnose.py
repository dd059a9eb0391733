"""The findings of an answer: what costs nothing always, what costs only where a scan is not localized."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ...answer.localization import Localization, Reason, Verdict
from ...answer.options import LocalizeOptions
from ...answer.scan_facts import ScanFacts
from ...answer.time_findings import no_times_finding, time_field_finding
from ...bit_exact.sample import rows_by_chance
from ...findings import scan_kinds
from ...findings.finding import Finding
from ...scan.compact import CompactScan
from ...scan.reduction import at_most
from ...scan.scan import Dropped, Scan
from ..config import PreprocessConfig
from ..map_search import MapSearch
from ..preprocess import PreparedQuery
from ..stopwatch import Stopwatch
from .facts import MEASURED, facts_of
from .input_findings import input_finding
from .other_forms import BETTER, OtherForm, other_forms
from .place_findings import mounting_finding, reasons_found
from .viewpoint import best_viewpoint, is_elsewhere, is_even, is_map_origin, is_suspect

FLAT = 0.01  # plane ratio of a 2-D LiDAR's scan
MAX_TIME = 4.0  # of the other forms, over that of the query
_FITS_FROM = 0.85  # inlier ratio of places that tie; poorer ones tie because nothing fits
_SLOWER = 1.5  # than the forms before it, at worst
GLANCED = 10_000  # points


@dataclass(frozen=True)
class AskedQuery:
    """A query as one map was asked.

    Attributes:
        scan: the last scan.
        is_single: the query had no other.
        prepared: the scans, prepared for this map; None: too few points.
        config: this map's.
        usual_height_m: of the map's own sensor above the floor.
        may_fit: whether another scan, or the scan with other options, may be found by the first search, with
            more than a share of it on the map.
        ask: makes this search; None: it may not.
        began: on ``time.monotonic``.
    """

    scan: Scan | CompactScan
    is_single: bool
    options: LocalizeOptions
    prepared: PreparedQuery | None
    config: PreprocessConfig
    usual_height_m: float
    may_fit: Callable[[Scan, LocalizeOptions, float], bool]
    ask: Callable[[Scan, LocalizeOptions, float], MapSearch | None]
    began: float

    @property
    def dropped(self) -> Dropped:
        """Point that the scan does not have, because the robot or the decoder left them out."""
        dropped = self.scan.dropped if isinstance(self.scan, Scan) else Dropped()
        return self.options.dropped or dropped

    @cached_property
    def _glanced(self) -> Scan:
        """A part of the scan, which is enough to see that a form of it does not fit."""
        assert isinstance(self.scan, Scan)
        count = len(self.scan)
        if count <= GLANCED:
            return self.scan
        rows = rows_by_chance(count, GLANCED)
        intensity, time_s = (
            None if values is None else values[rows] for values in (self.scan.intensity, self.scan.time_s)
        )
        return replace(self.scan, points=self.scan.points[rows], intensity=intensity, time_s=time_s)

    def ask_whole(self, form: OtherForm, least_ratio: float) -> MapSearch | None:
        """The first search of a form, as by ``ask``, unless a part of the scan shows that it does not fit."""
        assert isinstance(self.scan, Scan)
        is_part = len(self._glanced) < len(self.scan)
        if is_part and not self.may_fit(form.change(self._glanced), form.options, least_ratio):
            return None
        return self.ask(form.change(self.scan), form.options, least_ratio)

    @cached_property
    def part(self) -> NDArray[np.float32]:
        """A part of the scan's points, (m, 3): enough for its facts and to probe its viewpoint."""
        return at_most(self.scan.points, MEASURED)

    @property
    def facts(self) -> ScanFacts:
        """Facts of the last scan."""
        known = None
        if self.prepared is not None and self.is_single and isinstance(self.scan, Scan):
            known = self.prepared.in_range
        return facts_of(self.scan, self.part, self.dropped, self.config, known)


def diagnosed(answer: Localization, query: AskedQuery, watch: Stopwatch, *, explains: bool) -> Localization:
    """The answer with its scan's facts, findings and times. One of another viewpoint is not localized.

    Args:
        explains: a scan that does not fit as it was sent is tried in other forms, if the deadline allows, in
            at most twice the time that the query has taken.
    """
    facts = query.facts
    if answer.verdict is not Verdict.LOCALIZED:
        findings = _why_not_localized(answer, query, facts, watch, explains=explains)
        return replace(answer, scan=facts, findings=findings, timings_ms=watch.ms)
    found = _wrong_frame(answer, query, facts)
    if found is not None:
        answer = Localization(Verdict.REJECTED, (Reason.WRONG_FRAME,))
    else:
        found = mounting_finding(answer, query.options)
    findings = tuple(one for one in (found, time_field_finding(query.scan)) if one is not None)
    return replace(answer, scan=facts, findings=findings, timings_ms=watch.ms)


def _why_not_localized(
    answer: Localization, query: AskedQuery, facts: ScanFacts, watch: Stopwatch, *, explains: bool
) -> tuple[Finding, ...]:
    """The cause, if one is found: by points, another form or viewpoint. Then the reason; then the times."""
    cause = _by_points(answer, query, facts)
    if cause is None and explains and not _fits_as_sent(answer):
        cause = _by_other_forms(answer, query, watch)
    if cause is None:
        cause = _wrong_frame(answer, query, facts)
    times = time_field_finding(query.scan)
    if times is None and cause is None:
        times = no_times_finding(answer, facts)
    found = (cause, *reasons_found(answer), times)
    return tuple(one for one in found if one is not None)


def _fits_as_sent(answer: Localization) -> bool:
    """Whether a scan fits several places so well that no other form of it need be tried."""
    quality = answer.hypotheses[0].quality if answer.hypotheses else None
    return answer.verdict is Verdict.AMBIGUOUS and quality is not None and quality.inlier_ratio >= _FITS_FROM


def _wrong_frame(answer: Localization, query: AskedQuery, facts: ScanFacts) -> Finding | None:
    """The finding that the scan was not taken from its own origin.

    A localized scan is probed; the search is for suspects, for a pose at the map's own origin, and for
    what was not localized.
    """
    if query.prepared is None or not query.is_single or not isinstance(query.scan, Scan):
        return None
    T_map_sensor = answer.T_map_sensor
    at_origin = T_map_sensor is not None and is_map_origin(T_map_sensor)
    if T_map_sensor is not None and not at_origin and not is_suspect(query.part):
        return None
    points = query.prepared.scans[-1].seen
    if (at_origin or T_map_sensor is None) and is_even(points):
        return scan_kinds.NO_VIEWPOINT.found({"in_range": facts.in_range})
    best = best_viewpoint(points)
    if not is_elsewhere(best, T_map_sensor):
        return None
    x_m, y_m, z_m = best.position_m.tolist()
    return scan_kinds.OTHER_VIEWPOINT.found(
        {"x_m": x_m, "y_m": y_m, "z_m": z_m, "spread_ratio": best.spread_ratio}
    )


def _by_points(answer: Localization, query: AskedQuery, facts: ScanFacts) -> Finding | None:
    """The finding by the points of a scan that was not localized."""
    found = input_finding(facts, query.part, query.dropped)
    if found is not None:
        return found
    if facts.rings == 1 or (facts.plane_ratio is not None and facts.plane_ratio < FLAT):
        return scan_kinds.ONE_PLANE.found({"in_range": facts.in_range})
    if Reason.TOO_FEW_POINTS in answer.reasons:
        limits = query.config
        return scan_kinds.FEW_POINTS.found(
            {
                "points": facts.points,
                "in_range": facts.in_range,
                "min_range_m": limits.min_range_m,
                "max_range_m": limits.max_range_m,
                "needed": limits.min_points,
                "voxel_m": limits.voxel_m,
            }
        )
    return None


def _by_other_forms(answer: Localization, query: AskedQuery, watch: Stopwatch) -> Finding | None:
    """The finding of the first form in which the scan would be localized, if there is one."""
    if query.prepared is None or not query.is_single or not isinstance(query.scan, Scan):
        return None
    quality = answer.hypotheses[0].quality if answer.hypotheses else None
    sent_ratio = 0.0 if quality is None else quality.inlier_ratio
    height_m = query.prepared.scans[-1].height_m
    start = time.monotonic()
    end = min(start + MAX_TIME * (start - query.began), watch.deadline.at)
    longest_s = 0.0
    for form in other_forms(query.scan, query.options, height_m, query.usual_height_m):
        began = time.monotonic()
        if began + _SLOWER * longest_s > end:
            return None
        search = query.ask_whole(form, sent_ratio + BETTER / 2)
        longest_s = max(longest_s, time.monotonic() - began)
        if search is None or not search.is_settled:
            continue
        ratio = search.registered[0].quality.inlier_ratio
        if ratio > sent_ratio + BETTER:
            numbers = {"inlier_ratio": ratio, "inlier_ratio_as_sent": sent_ratio}
            return form.finding(search.registered[0], numbers)
    return None
