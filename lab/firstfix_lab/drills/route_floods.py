"""A flood of every route, which the app itself names: so a new route is among them."""

from __future__ import annotations

import re
from asyncio import StreamReader, StreamWriter

from fastapi.routing import iter_route_contexts

from firstfix_service.app import create_app
from firstfix_service.settings import Settings

from .floods import Act, Flood, Seen, Target, again, random_returns, read_status

CONNECTIONS = 250  # of one address: more would push each other out
SMALL_POINTS = 200
NOTHING = "nothing"  # of which there is none: builds, uploads, recorded queries
_READING = ("GET", "HEAD", "OPTIONS")
_EMPTY = "{}"
_BEYOND = [("GET", "/nothing"), ("DELETE", "/localize")]  # no such route, no such method


def route_floods() -> dict[str, Flood]:
    """Floods by method and path. Those that could change something come last."""
    app = create_app(Settings(store="memory://"))
    found = {
        (method, str(route.path))
        for route in iter_route_contexts(app.routes)
        for method in route.methods or ()
    }
    ordered = sorted([*found, *_BEYOND], key=lambda one: (one[0] not in _READING, one[1], one[0]))
    named = {f"{method} {path}": Flood(_act(method, path), CONNECTIONS) for method, path in ordered}
    return {**named, "small scans": Flood(_small_scans, CONNECTIONS)}


def _act(method: str, path: str) -> Act:
    async def ask(target: Target, reader: StreamReader, writer: StreamWriter, seen: Seen) -> None:
        known = {"map_id": target.map_id, "version": target.version}
        filled = re.sub(r"{(\w+)[^}]*}", lambda found: known.get(found[1], NOTHING), path)
        if method in _READING or method == "DELETE":
            request = target.head(method, filled)
        else:
            more = "Content-Type: application/json\r\n"
            request = target.head(method, filled, len(_EMPTY), more) + _EMPTY.encode()
        if path.endswith("/events"):
            writer.write(request)
            seen[await read_status(reader, has_body=False)] += 1
            return  # a stream has no end: the next one comes on another connection
        await again(request, reader, writer, seen, has_body=method != "HEAD")

    return ask


async def _small_scans(target: Target, reader: StreamReader, writer: StreamWriter, seen: Seen) -> None:
    """Small scans: beyond the queue and the rate they are refused."""
    body = random_returns(SMALL_POINTS)
    await again(target.localize(len(body)) + body, reader, writer, seen)
