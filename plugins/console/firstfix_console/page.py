"""/console/: the console's page. Its files are part of the package, and it asks no other host."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from fastapi import APIRouter, Request, Response
from fastapi.responses import RedirectResponse

from firstfix.errors import NotFound
from firstfix_service.http_api.edge import public
from firstfix_service.http_api.static_page import FOREVER, NEVER, READ, PageFile, page_file

router = APIRouter(include_in_schema=False)
FILES = Path(__file__).parent / "files"
INDEX = "index.html"


@router.api_route("/", methods=READ)
@router.api_route("/console", methods=READ)
@public
async def show_console() -> Response:
    """Redirect to the page, under whatever prefix a proxy puts before it."""
    _page()
    return RedirectResponse("console/", 307)


@router.api_route("/console/{path:path}", methods=READ)
@public
async def get_console_file(path: str, request: Request) -> Response:
    """A file of the page.

    Raises:
        NotFound: there is no such file, or this installation has no console.
    """
    file = _page().get(path or INDEX)
    if file is None:
        raise NotFound("the console has no such file")
    return file.answer(request)


@cache
def page_files() -> dict[str, PageFile]:
    """The files of this installation. Read once: names in requests never touch the disk."""
    return read_page(FILES)


def read_page(folder: Path) -> dict[str, PageFile]:
    """The page's files in a folder, by name; none where there is no folder."""
    names = {
        path.relative_to(folder).as_posix(): path for path in sorted(folder.rglob("*")) if path.is_file()
    }
    # the names of the assets hold a hash of their content
    return {
        name: page_file(path, FOREVER if name.startswith("assets/") else NEVER)
        for name, path in names.items()
    }


def _page() -> dict[str, PageFile]:
    found = page_files()
    if not found:
        raise NotFound("this installation has no console: build it with `make console`")
    return found
