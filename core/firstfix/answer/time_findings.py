"""Findings by the times of a scan's points: a field that was not understood, and a scan without any."""

from __future__ import annotations

from dataclasses import replace

from ..findings import scan_kinds
from ..findings.finding import Finding
from ..scan.compact import CompactScan
from ..scan.scan import Scan
from .localization import Localization, Reason
from .scan_facts import ScanFacts

# A scan that was taken in motion and has no times is bent: it fits, but not well.
_BENT = (Reason.LOW_PROBABILITY, Reason.LOW_INLIER_RATIO)


def time_field_finding(scan: Scan | CompactScan) -> Finding | None:
    """The finding that a field looks like times and was not understood.

    A field of zeros is none: drivers fill them in where they know no times.
    """
    field = scan.time_field if isinstance(scan, Scan) and scan.time_s is None else None
    if field is None or field.is_filling:
        return None
    numbers = {"first": field.first, "last": field.last}
    return scan_kinds.TIME_FIELD_UNKNOWN.found(numbers, field=field.described, why=field.why)


def with_time_field(answer: Localization, scan: Scan | CompactScan) -> Localization:
    """The answer to a scan that was sent without its field, with the finding about this field."""
    found = time_field_finding(scan)
    if found is None or any(one.code == found.code for one in answer.findings):
        return answer
    others = tuple(one for one in answer.findings if one.code != scan_kinds.NO_TIMES.code)
    return replace(answer, findings=(*others, found))


def no_times_finding(answer: Localization, facts: ScanFacts) -> Finding | None:
    """The finding that an answer may be unsure because the robot moved, and the scan has no times."""
    is_bent = bool(answer.reasons) and answer.reasons[0] in _BENT
    return scan_kinds.NO_TIMES.found() if is_bent and facts.time_span_s is None else None
