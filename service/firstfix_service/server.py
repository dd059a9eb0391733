"""Running the service as a process."""

from __future__ import annotations

import uvicorn
from fastapi import FastAPI

from .app import create_app
from .http_protocol import LimitedHttpProtocol
from .log_setup import set_up_logging
from .settings import Settings

STOP_WITHIN_S = 20  # for requests under way, then they are broken off


def uvicorn_config(app: FastAPI, settings: Settings) -> uvicorn.Config:
    return uvicorn.Config(
        app,
        host=settings.host,
        port=settings.port,
        loop="auto",  # uvloop where it is installed
        http=LimitedHttpProtocol,
        ws="none",
        access_log=False,  # RequestLog writes one line a request
        log_config=None,
        server_header=False,
        proxy_headers=False,
        timeout_keep_alive=30,
        timeout_graceful_shutdown=STOP_WITHIN_S,
        lifespan="on",
    )


def serve(settings: Settings) -> None:
    """Serves until SIGINT or SIGTERM.

    Raises:
        SystemExit: it could not start; the log says why.
    """
    set_up_logging(settings.log_level, as_json=settings.log_json)
    uvicorn.Server(uvicorn_config(create_app(settings), settings)).run()
