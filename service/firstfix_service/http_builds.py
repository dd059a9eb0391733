"""/builds: how far a build is, and stopping it."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter, Response

from firstfix.build_records import FINAL_STATES, new_status

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
    """Asks the build to stop. One that waits in this process's queue is cancelled at once, a running
    one within seconds: its status says when."""
    parts.catalog.request_cancel(build_id)
    status = parts.catalog.build_status(build_id)
    if parts.builds is not None:
        if status["state"] == "queued" and parts.builds.running != build_id:
            status = new_status("cancelled", map_id=status["map_id"])
            parts.catalog.set_build_status(build_id, status)
        parts.builds.cancelled(build_id)
    return {"build_id": build_id, **status}
