"""The permission of a request that takes long: it is asked for again while the request goes on, since a key
may be revoked, or expire, meanwhile."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Annotated

from fastapi import Depends, Request
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from firstfix.access import permissions as grant

from .authenticate import Access

CHECK_S = 1.0  # between two checks: they read memory, and of a token its signature


@dataclass(frozen=True)
class Permission:
    """Attributes: map_id: that the request is about, as far as its path tells."""

    access: Access
    credential: str | None
    address: str
    scope: grant.Scope
    map_id: str | None

    async def check(self, map_id: str | None = None) -> None:
        """
        Args:
            map_id: that the request turned out to be about.

        Raises:
            Unauthorized, Forbidden, RateLimited, StoreUnavailable, Overloaded: as ``Access.check``.
        """
        await self.access.check(self.credential, self.scope, map_id or self.map_id, address=self.address)


async def permission_of(request: Request) -> Permission:
    permission: Permission = request.state.permission
    return permission


PermissionDep = Annotated[Permission, Depends(permission_of)]


class WhilePermitted:
    """ASGI middleware: whoever reads the body of a request gets the error when its permission has ended."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        checked_at = time.monotonic()

        async def receive_while_permitted() -> Message:
            nonlocal checked_at
            message = await receive()
            permission: Permission | None = scope.get("state", {}).get("permission")
            if permission is not None and message["type"] == "http.request":
                now = time.monotonic()
                if now - checked_at >= CHECK_S:
                    await permission.check()
                    checked_at = now
            return message

        await self._app(scope, receive_while_permitted, send)
