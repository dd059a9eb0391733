"""The short way of a request: routes of fixed paths whose functions get the request and nothing else.

The framework documents them, and takes no part in an answer: its own layers, the search for the route and the
dependencies take longer than all else that the service does for a query.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from fastapi import Request, Response
from fastapi.routing import APIRoute
from starlette.types import Receive, Scope, Send

from firstfix.errors import FirstfixError

from ..limits.byte_budget import ByteBudget
from ..problems import method_not_allowed
from .edge import LoggedAnswer, authorize
from .nearest_map import problem_for
from .response_budget import CountedAnswers


class DirectRoute(APIRoute):
    """A route in the framework's words, for its document. ``DirectAnswers`` calls its function."""


def direct_routes(routes: Iterable[Any]) -> dict[str, DirectRoute]:
    """Routes that go the short way, by path.

    Raises:
        TypeError: the path of one has parameters, or another one has the same path.
    """
    found: dict[str, DirectRoute] = {}
    paths = [route.path for route in routes]
    for route in routes:
        if isinstance(route.original_route, DirectRoute):
            if "{" in route.path or paths.count(route.path) > 1:
                raise TypeError(f"{route.path} cannot be direct: its path has parameters, or two routes")
            found[route.path] = route.original_route
    return found


class EncodedResponse(Response):
    """An answer whose bytes and headers are there: nothing is left to encode."""

    def __init__(self, body: bytes, headers: Iterable[tuple[bytes, bytes]]) -> None:
        self.status_code = 200
        self.background = None
        self.body = body
        self.raw_headers = [*headers]


class DirectAnswers:
    """ASGI app that answers requests to the ``DirectRoute`` in their scope.

    An unexpected error is for the layer around it.

    Args:
        budget: of large answers.
    """

    def __init__(self, budget: ByteBudget) -> None:
        self._budget = budget

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one request."""
        route: DirectRoute = scope["route"]
        request: Request = Request(scope, receive, send)
        methods: set[str] = route.methods or set()
        response: Response
        try:
            if scope["method"] in methods:
                await authorize(request)
                response = await route.endpoint(request)
            else:
                response = method_not_allowed(methods).response()
        except FirstfixError as error:
            response = (await problem_for(request, error)).response()
        answer: LoggedAnswer = scope["state"]["answer"]
        if not await answer.send_whole(response):
            await CountedAnswers(response, self._budget)(scope, receive, send)
