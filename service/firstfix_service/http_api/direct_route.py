"""Route of requests that are too many to be taken apart by the framework."""

from __future__ import annotations

from typing import Any

from fastapi import Request, Response
from fastapi.routing import APIRoute
from starlette.exceptions import HTTPException
from starlette.types import Receive, Scope, Send

from .edge import authorize


class DirectRoute(APIRoute):
    """A route whose function gets the request and nothing else, right after the gate.

    The framework documents the route, but it resolves no dependencies: that takes as long as all else that
    the service does for a query. The app's handlers answer its errors.
    """

    async def handle(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serves one request."""
        methods = self.methods or set()
        if scope["method"] not in methods:
            raise HTTPException(405, headers={"Allow": ", ".join(sorted(methods))})
        request: Request[Any] = Request(scope, receive, send)
        await authorize(request)
        response: Response = await self.endpoint(request)
        await response(scope, receive, send)
