"""The app: FastAPI, whose document also has the bodies that the service parses itself, and the short way."""

from __future__ import annotations

import json
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from fastapi import FastAPI, Request, Response
from fastapi.routing import iter_route_contexts
from starlette.types import ASGIApp, Receive, Scope, Send

from ..thread_pools import LISTS
from .edge import public
from .schema.bodies import SCHEMAS
from .schema.map_submission import CONFIG_SCHEMAS
from .short_way import DirectRoute, direct_routes


class DocumentedApp(FastAPI):
    """An app whose document also has the schemas that no route's signature names.

    Requests to its direct routes do not pass through the framework (``short_way``).
    """

    _direct: Mapping[str, DirectRoute] = MappingProxyType({})

    def take_short_way(self, answer_directly: ASGIApp) -> None:
        """Answer the direct routes that were added by this app, which finds the route in the scope.

        Raises:
            TypeError: as ``direct_routes``.
        """
        self._direct = direct_routes(list(iter_route_contexts(self.routes)))
        self._answer_directly = answer_directly

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one request, or the lifespan."""
        route = self._direct.get(scope["path"]) if scope["type"] == "http" else None
        if route is None:
            await super().__call__(scope, receive, send)
            return
        scope["app"], scope["route"], scope["endpoint"] = self, route, route.endpoint
        await self._answer_directly(scope, receive, send)

    def openapi(self) -> dict[str, Any]:
        """The document."""
        if self.openapi_schema is None:
            schemas = super().openapi()["components"]["schemas"]
            schemas.update({**CONFIG_SCHEMAS, **SCHEMAS})
        assert self.openapi_schema is not None
        return self.openapi_schema

    def setup(self) -> None:
        """Add the document's route.

        Its bytes are made once: the route is public, and making them takes longer than a query.
        """
        made: list[bytes] = []

        def make() -> bytes:
            return json.dumps(self.openapi(), separators=(",", ":")).encode()

        @public
        async def openapi(request: Request) -> Response:
            if not made:
                made.append(await LISTS.run(make))
            return Response(made[0], media_type="application/json")

        assert self.openapi_url is not None
        self.add_route(self.openapi_url, openapi, include_in_schema=False)
