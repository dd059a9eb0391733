"""Facts understood of a scan: fields, unit, times, frame, beams, mounting, and what was left out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from firstfix.answer.time_findings import time_field_finding
from firstfix.engine.config import PreprocessConfig
from firstfix.engine.diagnosis.facts import MEASURED, facts_of
from firstfix.engine.diagnosis.input_findings import input_finding
from firstfix.engine.diagnosis.place_findings import roll_pitch_deg
from firstfix.engine.preprocess import preprocess
from firstfix.findings.finding import Finding
from firstfix.formats.point_cloud import INTENSITY_NAMES, RING_NAMES, PointCloud
from firstfix.formats.point_times import is_time_name
from firstfix.scan.levelling import floor_height, turned
from firstfix.scan.reduction import at_most
from firstfix.scan.scan import Scan
from firstfix.scan.sequence import ScanSequence
from firstfix.scan_file import scan_of_cloud
from firstfix.transform import make_transform

_CLOCKS = {
    "stamp": "counted from the scan's stamp",
    "epoch": "since the epoch, by the clock of the stamp",
    "own": "by another clock, so counted from the first point",
}


@dataclass(frozen=True)
class ScanReport:
    """Facts that were understood of one scan.

    Attributes:
        summary: its points in one line.
        understood: one word or sentence by subject: fields, times, frame, rings, mounting, left_out.
        findings: what is wrong with it.
    """

    summary: str
    understood: dict[str, str]
    findings: list[Finding]

    def to_mapping(self) -> dict[str, Any]:
        """Values ready for JSON."""
        return {
            "facts": self.summary,
            "understood": self.understood,
            "findings": [one.to_mapping() for one in self.findings],
        }


def report_of_cloud(cloud: PointCloud, scan: Scan | None = None, frame_id: str = "") -> ScanReport:
    """The report on the columns of a file, or of a message.

    Args:
        scan: made of the columns; None: it is made here.
        frame_id: of the message.
    """
    if scan is None:
        scan = scan_of_cloud(cloud)
    part = at_most(scan.points, MEASURED)
    facts = facts_of(scan, part, scan.dropped, PreprocessConfig())
    median = "" if facts.median_range_m is None else f", median range {facts.median_range_m:,.1f} m"
    found = (input_finding(facts, part, scan.dropped), time_field_finding(scan))
    ring = cloud.ring
    understood = {
        "fields": _fields(cloud),
        "times": times_in_words(scan),
        "rings": f"{len(np.unique(ring))}, by the field"
        if ring is not None
        else f"{facts.rings or 'not told'}",
        "frame": frame_id or "the file names none: taken for the sensor's own",
        "mounting": _mounting(scan),
        "left_out": _left_out(scan, facts.in_range),
    }
    return ScanReport(
        f"{facts.points:,} points, {facts.in_range:,} of them in range{median}",
        understood,
        [one for one in found if one is not None],
    )


def times_in_words(scan: Scan) -> str:
    """How the times of a scan's points were understood."""
    field = scan.time_field
    if scan.time_s is not None and len(scan.time_s):
        first, last = float(scan.time_s.min()), float(scan.time_s.max())
        told = "" if field is None else f"{field.described}, {_CLOCKS.get(field.clock or '', '')}: "
        return f"{told}{first:.4f} to {last:.4f} s from the stamp"
    if field is None:
        return "none: taken for a scan of a sensor at rest"
    return f"none: {field.described} was not understood: {field.why}"


def _fields(cloud: PointCloud) -> str:
    by_use = {"intensity": INTENSITY_NAMES, "ring": RING_NAMES}
    said = []
    for name, column in cloud.columns.items():
        use = next((use for use, names in by_use.items() if name.lower() in names), "")
        use = "time" if is_time_name(name) else use
        as_use = f" as {use}" if use and use != name.lower() else ""
        said.append(f"{name} {column.dtype.newbyteorder('=').name}{as_use}")
    return ", ".join(said) + "; metres"


def _mounting(scan: Scan) -> str:
    """How the sensor stands, by the level surfaces and walls that it sees."""
    prepared = preprocess(ScanSequence.single(scan), None, PreprocessConfig())
    if prepared is None:
        return "not told: too few points"
    (one,) = prepared.scans
    roll, pitch = roll_pitch_deg(make_transform(one.R_level_sensor, np.zeros(3)))
    height_m = floor_height(
        turned(one.thinned.points, one.R_level_sensor), turned(one.thinned.normals, one.R_level_sensor)
    )
    above = "no floor is seen" if height_m is None else f"{height_m:.2f} m above the floor"
    return f"roll {round(roll)}, pitch {round(pitch)} degrees, {above}"


def _left_out(scan: Scan, in_range: int) -> str:
    said = {
        "not finite": scan.dropped.not_finite,
        "beyond 1,000 m": scan.dropped.too_far,
        "nearer or farther than the range that is used": len(scan) - in_range,
    }
    return ", ".join(f"{count:,} points {why}" for why, count in said.items() if count) or "nothing"
