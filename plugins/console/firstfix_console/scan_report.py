"""POST /scan-report: what was understood of a scan, before anybody asks where it was taken."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from fastapi import APIRouter, Request
from pydantic import BaseModel, Field

from firstfix.access.permissions import Scope
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
from firstfix.scan_formats import LAS, MEDIA_TYPES
from firstfix_cli.scan_report import ScanReport, report_of_cloud
from firstfix_service.http_api.edge import CallerDep, needs
from firstfix_service.http_api.parts import LocalizePartsDep
from firstfix_service.http_api.schema.answer_models import Finding
from firstfix_service.http_api.schema.bodies import binary_body
from firstfix_service.query_workers.query import BodyFormat
from firstfix_service.thread_pools import LOOKS

router = APIRouter(tags=["localize"])
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


class UnderstoodScan(BaseModel):
    """A scan as it was understood: the same as `firstfix check` says of its file."""

    facts: str = Field(description="its points in one line")
    understood: dict[str, str] = Field(
        description="a word or a sentence for `format`, `fields`, `times` (field, unit and clock), `rings`, "
        "`frame`, `mounting` and `left_out`"
    )
    findings: list[Finding] = Field(description="what is wrong with it")


@router.post("/scan-report", openapi_extra=binary_body(MEDIA_TYPES))
@needs(Scope.LOCALIZE, "localize")
async def post_scan_report(request: Request, parts: LocalizePartsDep, caller: CallerDep) -> UnderstoodScan:
    """Report what is understood of a scan: format, fields, times, rings, mounting, and what is left out.

    The body is that of `POST /localize`. No map is asked.
    """
    media_type = request.headers.get("content-type", "")
    body_format = BodyFormat.of(media_type, request.headers.get("content-encoding"))
    with parts.overlays.request(caller.name):
        body = await parts.bodies.read(request, caller.name)
        try:
            report = await LOOKS.run(_report, body_format, media_type, body, parts.max_body_bytes)
        finally:
            parts.bodies.release(body, caller.name)
    return UnderstoodScan.model_validate(report)


def _report(body_format: BodyFormat, media_type: str, body: Body, limit: int) -> dict[str, Any]:
    name, _, parameters = media_type.partition(";")
    name = name.strip().lower()
    data = body_format.decompress(body, limit)
    if name in GENERAL_TYPES:
        name = media_type_of(data)
    decode = None if "columns" in parameters else _COLUMNS.get(name)
    if decode is not None:
        report = report_of_cloud(decode(data, SCAN_LIMITS))
    else:
        report = _report_of(body_format.decode(data))
    said = report.to_mapping()
    return {**said, "understood": {"format": name, **said["understood"]}}


def _report_of(scan: object) -> ScanReport:
    last = scan.scans[-1] if isinstance(scan, ScanSequence) else scan
    if not isinstance(last, Scan):
        raise UnsupportedFormat("a compact query or a descriptor has no points to tell of")
    columns = dict(zip("xyz", last.points.T, strict=True))
    if last.intensity is not None:
        columns["intensity"] = last.intensity
    return report_of_cloud(PointCloud(columns), last)
