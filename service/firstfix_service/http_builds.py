"""/builds: how far a build is, and stopping it."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter, Response

from firstfix.build_records import FINAL_STATES

from .cancel_build import cancel_build as cancel_build_anywhere
from .parts import PartsDep

router = APIRouter(prefix="/builds", tags=["builds"])
RETRY_AFTER_S = 2


@router.get("/{build_id}")
def get_build(build_id: str, parts: PartsDep, response: Response) -> dict[str, Any]:
    """State, stage, progress, error, and the version once it has succeeded."""
    status = parts.catalog.build_status(build_id)
    if status["state"] not in FINAL_STATES:
        response.headers["Retry-After"] = str(RETRY_AFTER_S)
    return {"build_id": build_id, **status}


@router.delete("/{build_id}", status_code=202)
def cancel_build(build_id: str, parts: PartsDep) -> dict[str, Any]:
    """Asks the build to stop. One that waits is cancelled at once, a running one within seconds: its
    status says when."""
    return {"build_id": build_id, **cancel_build_anywhere(parts.catalog, build_id)}
