"""The problem of a request, which names the map that a caller seems to have meant."""

from __future__ import annotations

from collections.abc import Iterator

from fastapi import FastAPI, Request, Response

from firstfix.catalog.nearest_map import with_nearest
from firstfix.errors import FirstfixError, NotFound

from ..auth.principal import Principal
from ..problems import Problem, problem_of
from ..thread_pools import READS
from .parts import MapParts, part_of


async def problem_for(request: Request, error: FirstfixError) -> Problem:
    """The problem document of a route's error.

    Where there is no such map, it names the one that is meant, of those that are published and that the
    caller sees.
    """
    caller: Principal | None = request.scope["state"].get("caller")
    if caller is None or not isinstance(error, NotFound) or not error.map_id:
        return problem_of(error)
    sees, served = caller.sees, part_of(request, MapParts).maps.served

    def names() -> Iterator[str]:
        return filter(sees, served.ids)

    return problem_of(await READS.run(with_nearest, error, names))


def add_handler(app: FastAPI) -> None:
    """Let the problems of routes name the nearest map."""
    app.add_exception_handler(NotFound, _on_not_found)


async def _on_not_found(request: Request, error: Exception) -> Response:
    assert isinstance(error, NotFound)
    return (await problem_for(request, error)).response()
