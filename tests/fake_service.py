"""A service on loopback that tells scans apart by their point count and answers from a table."""

from __future__ import annotations

import json
import socket
import threading
from collections.abc import Mapping

import uvicorn
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from firstfix.answer.localization import Localization
from firstfix.scan.scan import Scan
from firstfix.wire import scan as wire
from tests.waiting import LIMIT_S

VERSIONS = ["aa" * 32, "ab" * 32]


class FakeService:
    """Answers ``/localize`` from a table of point counts; keeps what it was sent."""

    def __init__(self, answers: Mapping[int, Localization]) -> None:
        self.answers = answers
        self.scans: list[Scan] = []
        self.queries: list[dict[str, str]] = []
        self.activated: list[str] = []
        app = Starlette(
            routes=[
                Route("/localize", self._localize, methods=["POST"]),
                Route("/maps", self._maps),
                Route("/maps/{map_id}", self._map),
                Route("/maps/{map_id}/versions", self._versions),
                Route("/maps/{map_id}/versions/{version}/activate", self._activate, methods=["POST"]),
            ]
        )
        listener = socket.create_server(("127.0.0.1", 0))
        self.url = f"http://127.0.0.1:{listener.getsockname()[1]}"
        self._server = uvicorn.Server(uvicorn.Config(app, log_level="critical", lifespan="off"))
        self._thread = threading.Thread(target=self._server.run, args=([listener],), daemon=True)
        self._thread.start()

    def stop(self) -> None:
        self._server.should_exit = True
        self._thread.join(LIMIT_S)

    async def _localize(self, request: Request) -> Response:
        query = dict(request.query_params)
        if query["map"] != "hall":
            return _problem("not_found", f"no map {query['map']}", 404)
        scan = wire.decode_scan(await request.body())
        self.scans.append(scan)
        self.queries.append(query)
        return JSONResponse(self.answers[len(scan)].to_mapping())

    async def _maps(self, request: Request) -> Response:
        return JSONResponse({"maps": [{"map_id": "hall", "active_version": VERSIONS[0]}]})

    async def _map(self, request: Request) -> Response:
        if request.path_params["map_id"] != "hall":
            return _problem("not_found", f"no map {request.path_params['map_id']}", 404)
        manifest = {
            "counts": {"templates": 12},
            "files": {"a": {"bytes": 2_000_000}},
            "sensor": {"name": "xt32"},
            "bounds": [[0, 0, 0], [10, 20, 3]],
            "self_test": {},
        }
        return JSONResponse(
            {"map_id": "hall", "active_version": VERSIONS[0], "versions": 2, "manifest": manifest}
        )

    async def _versions(self, request: Request) -> Response:
        times = ("2025-01-02T00:00:00Z", "2025-01-01T00:00:00Z")
        found = [
            {"version": version, "active": version == VERSIONS[0], "published_time": time}
            for version, time in zip(VERSIONS, times, strict=True)
        ]
        return JSONResponse({"versions": found})

    async def _activate(self, request: Request) -> Response:
        self.activated.append(request.path_params["version"])
        return JSONResponse({})


def _problem(code: str, detail: str, status: int) -> Response:
    body = json.dumps({"type": "about:blank", "title": code, "detail": detail, "code": code})
    return Response(body, status, media_type="application/problem+json")
