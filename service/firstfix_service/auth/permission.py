"""Permission of a long request, checked again and again because a key can expire or be revoked."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Annotated

from fastapi import Depends, Request
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from firstfix.access import permissions as grant

from .authenticate import Authenticator
from .principal import Needs

CHECK_S = 1.0  # between two checks: they read memory only, and verify the signature of a token


@dataclass(frozen=True)
class Permission:
    """Permission of one request.

    Attributes:
        map_id: the map in the path of the request, if any.
    """

    authenticator: Authenticator
    credential: str | None
    address: str
    scope: grant.Scope
    map_id: str | None

    async def check(self, map_id: str | None = None) -> None:
        """Checks that the permission is still valid.

        Args:
            map_id: the map of the request, if it is not in the path.

        Raises:
            FirstfixError: see ``Authenticator.authorize``.
        """
        await self.authenticator.authorize(
            self.credential, self.address, Needs(self.scope), map_id or self.map_id
        )


async def permission_of(request: Request) -> Permission:
    """Dependency of routes: the permission that ``authorize`` found."""
    permission: Permission = request.state.permission
    return permission


PermissionDep = Annotated[Permission, Depends(permission_of)]


class WhilePermitted:
    """ASGI middleware that raises in the reader of a request body when the permission has ended."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serves a request."""
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
