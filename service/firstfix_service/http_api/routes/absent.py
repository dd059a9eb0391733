"""Routes of packages that are not installed: each says whose it is, in place of a bare 404."""

from __future__ import annotations

from fastapi import APIRouter, FastAPI

from firstfix.doors import PACKAGES, Package
from firstfix.errors import NotFound

from ..edge import public

METHODS = ["GET", "HEAD", "POST"]


def add_absent_routes(app: FastAPI) -> None:
    """Adds those that no package has brought."""
    present = {getattr(route, "path", "") for route in app.routes}
    for package in PACKAGES:
        if absent := [path for path in package.routes if path not in present and not _is_off(app, path)]:
            app.include_router(_router_of(package, absent))


def _is_off(app: FastAPI, path: str) -> bool:
    """Whether the operator wants no page: then nothing is missing."""
    return path in ("/", "/console", "/console/{path:path}") and not app.state.settings.console


def _router_of(package: Package, paths: list[str]) -> APIRouter:
    @public
    async def absent() -> None:
        raise NotFound(package.remedy("this"))

    router = APIRouter(include_in_schema=False)
    for path in paths:
        router.add_api_route(path, absent, methods=METHODS)
    return router
