"""Report on a scan in a request's body: the work of a worker process."""

from __future__ import annotations

from collections.abc import Callable

import orjson

from firstfix.decode import GENERAL_TYPES
from firstfix.errors import UnsupportedFormat
from firstfix.formats.confined_las import decode_las_confined
from firstfix.formats.npy import decode_npy
from firstfix.formats.pcd import decode_pcd
from firstfix.formats.ply import decode_ply
from firstfix.formats.point_cloud import SCAN_LIMITS, Body, Limits, PointCloud
from firstfix.formats.raw_xyz import decode_xyzi
from firstfix.formats.signature import media_type_of
from firstfix.formats.text import decode_text
from firstfix.scan.scan import Scan
from firstfix.scan.sequence import ScanSequence
from firstfix.scan_formats import LAS
from firstfix_cli.scan_report import ScanReport, report_of_cloud
from firstfix_service.query_workers.look import Look

# Those whose bodies have columns with names; of all others, points and times are what they have.
_COLUMNS: dict[str, Callable[[Body, Limits], PointCloud]] = {
    "application/x-pcd": decode_pcd,
    "model/vnd.pcd": decode_pcd,
    "application/ply": decode_ply,
    "model/ply": decode_ply,
    "application/vnd.firstfix.xyzi": decode_xyzi,
    "application/x-npy": decode_npy,
    "text/csv": decode_text,
    "text/plain": decode_text,
    **dict.fromkeys(LAS, decode_las_confined),
}


def understood(media_type: str, look: Look, body: Body) -> bytes:
    """The report on a scan, as JSON.

    Args:
        media_type: with its parameters.
        body: without its content encoding.

    Raises:
        InputError: the body cannot be used.
    """
    name, _, parameters = media_type.partition(";")
    name = name.strip().lower()
    if name in GENERAL_TYPES:
        name = media_type_of(body)
    decode = None if "columns" in parameters else _COLUMNS.get(name)
    report = (
        _report_of(look.body_format.decode(body))
        if decode is None
        else report_of_cloud(decode(body, SCAN_LIMITS))
    )
    said = report.to_mapping()
    return orjson.dumps({**said, "understood": {"format": name, **said["understood"]}})


def _report_of(scan: object) -> ScanReport:
    last = scan.scans[-1] if isinstance(scan, ScanSequence) else scan
    if not isinstance(last, Scan):
        raise UnsupportedFormat("a compact query or a descriptor has no points to tell of")
    columns = dict(zip("xyz", last.points.T, strict=True))
    if last.intensity is not None:
        columns["intensity"] = last.intensity
    return report_of_cloud(PointCloud(columns), last)
