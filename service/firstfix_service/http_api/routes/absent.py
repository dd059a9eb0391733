"""Routes of packages that are not installed: each says whose it is, in place of a bare 404."""

from __future__ import annotations

from fastapi import APIRouter

from firstfix.doors import Package
from firstfix.errors import NotFound

from ..edge import public


def absent_routes(package: Package) -> APIRouter:
    """The routes of a package that is not installed."""

    @public
    async def absent() -> None:
        raise NotFound(package.remedy("this"))

    router = APIRouter(include_in_schema=False)
    for path in package.routes:
        router.add_api_route(path, absent, methods=["GET", "HEAD", "POST"])
    return router
