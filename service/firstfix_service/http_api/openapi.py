"""The OpenAPI document: FastAPI's own, and the schemas of bodies that the service parses itself."""

from __future__ import annotations

import json
from typing import Any

from fastapi import FastAPI, Request, Response

from ..thread_pools import LISTS
from .edge import public
from .schema.bodies import SCHEMAS
from .schema.map_submission import CONFIG_SCHEMAS


class DocumentedApp(FastAPI):
    """An app whose document also has the schemas that no route's signature names."""

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
