"""/caller: who the caller is and what it may do."""

from __future__ import annotations

from fastapi import APIRouter

from firstfix.access.permissions import Scope

from ...edge import CallerDep
from ...parts import PartsDep
from ...schema.api_models import Caller

router = APIRouter(tags=["operations"])


@router.get("/caller")
async def get_caller(parts: PartsDep, caller: CallerDep) -> Caller:
    """The caller and its permissions: a page shows only what they allow."""
    return Caller(
        name=caller.name,
        scopes=[scope.value for scope in Scope if caller.grant.allows(scope)],
        maps=list(caller.grant.maps),
        authentication=parts.settings.auth == "on",
        read_only=parts.settings.read_only,
    )
