"""POST /scan-report: what was understood of a scan, before anybody asks where it was taken."""

from __future__ import annotations

from functools import partial

from fastapi import APIRouter, Request
from pydantic import BaseModel, Field

from firstfix.access.permissions import Scope
from firstfix.scan_formats import MEDIA_TYPES
from firstfix_service.http_api.edge import CallerDep, needs
from firstfix_service.http_api.parts import LocalizePartsDep
from firstfix_service.http_api.schema.answer_models import Finding
from firstfix_service.http_api.schema.bodies import binary_body

from .look import look_at
from .understood_scan import understood

router = APIRouter(tags=["localize"])


class UnderstoodScan(BaseModel):
    """A scan as it was understood: the same as `firstfix check` says of its file."""

    facts: str = Field(description="its points in one line")
    understood: dict[str, str] = Field(
        description="a word or a sentence for `format`, `fields`, `times` (field, unit and clock), `rings`, "
        "`frame`, `mounting` and `left_out`"
    )
    findings: list[Finding] = Field(description="what is wrong with it")


@router.post("/scan-report", openapi_extra=binary_body(MEDIA_TYPES))
@needs(Scope.LOCALIZE, "localize", has_queue=True)
async def post_scan_report(request: Request, parts: LocalizePartsDep, caller: CallerDep) -> UnderstoodScan:
    """Report what is understood of a scan: format, fields, times, rings, mounting, and what is left out.

    The body is that of `POST /localize`. No map is asked.
    """
    media_type = request.headers.get("content-type", "")
    report = await look_at(request, parts, caller, partial(understood, media_type))
    return UnderstoodScan.model_validate_json(report)
