"""A service in a process of its own, as ``firstfix serve`` runs it, that can be made to stand still.

GET /stall/{seconds} blocks the event loop for that long. Settings come from the environment.
"""

from __future__ import annotations

from fastapi import FastAPI, Request, Response

from firstfix_service import server
from firstfix_service.settings import Settings
from tests.waiting import let_pass

_create_app = server.create_app


def create_stalling_app(settings: Settings) -> FastAPI:
    app = _create_app(settings)

    async def stall(request: Request) -> Response:
        let_pass(float(request.path_params["seconds"]))
        return Response()

    app.router.add_route("/stall/{seconds}", stall)
    return app


if __name__ == "__main__":
    server.create_app = create_stalling_app
    server.serve(Settings())
