"""/docs: the HTTP API as a page to read and to try, by Swagger UI. It asks no other host."""

from __future__ import annotations

from functools import cache
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

from fastapi import APIRouter, Request, Response
from fastapi.responses import RedirectResponse

from firstfix.errors import NotFound, pip_install

from ...thread_pools import READS
from ..edge import public
from ..static_page import READ, PageFile, page_file

router = APIRouter(include_in_schema=False)
_OWN = Path(__file__).parents[1] / "api_page"
_OF_SWAGGER = ("swagger-ui-bundle.js", "swagger-ui.css")
_DAY = "public, max-age=86400"


@router.api_route("/docs", methods=READ)
@public
async def show_api(request: Request) -> Response:
    """The page, which names its files relative to itself.

    Raises:
        NotFound: this installation has no Swagger UI.
    """
    return (await READS.run(page_files))["index.html"].answer(request)


@router.api_route("/docs/{name}", methods=READ)
@public
async def get_api_file(name: str, request: Request) -> Response:
    """A file of the page.

    Raises:
        NotFound: there is no such file, or this installation has no Swagger UI.
    """
    file = (await READS.run(page_files)).get(name)
    if file is None:
        raise NotFound("the page of the API has no such file")
    return file.answer(request)


@router.api_route("/redoc", methods=READ)
@router.api_route("/swagger", methods=READ)
@public
async def lead_to_docs() -> Response:
    """Redirect to the page, from where other services have theirs."""
    return RedirectResponse("docs", 307)


@cache
def page_files() -> dict[str, PageFile]:
    """The files, packed once: names in requests never touch the disk.

    Raises:
        NotFound: the package that has Swagger UI is not installed.
    """
    try:
        package = distribution("fastapi-offline")  # taken for its files; its code is not run
    except PackageNotFoundError:
        raise NotFound(
            f"the page of the API needs Swagger UI: {pip_install('.[service]')}; /openapi.json has the same"
        ) from None
    theirs = Path(str(package.locate_file("fastapi_offline/static")))
    return {
        **{name: page_file(_OWN / name) for name in ("index.html", "start.js")},
        **{name: page_file(theirs / name, _DAY) for name in _OF_SWAGGER},
    }
