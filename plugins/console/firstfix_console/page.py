"""/console/: the console's page. Its files are part of the package, and it asks no other host."""

from __future__ import annotations

import gzip
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from fastapi import APIRouter, Request, Response
from fastapi.responses import RedirectResponse

from firstfix.errors import NotFound
from firstfix_service.http_api.edge import public
from firstfix_service.http_api.routes.versions import FOREVER

router = APIRouter(include_in_schema=False)
FILES = Path(__file__).parent / "files"
INDEX = "index.html"
# Not those of the machine, which may know other names.
MEDIA_TYPES = {
    ".css": "text/css",
    ".html": "text/html",
    ".js": "text/javascript",
    ".svg": "image/svg+xml",
    ".txt": "text/plain",
    ".woff2": "font/woff2",
}
_NEVER = "no-cache"  # asked for again each time: it names the files of this release
_HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; "
    "img-src 'self' data: blob:; connect-src 'self'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Vary": "Accept-Encoding",
}
_READ = ["GET", "HEAD"]


@dataclass(frozen=True)
class PageFile:
    """One file of the page.

    Attributes:
        packed: the content with gzip.
        caching: the value of Cache-Control.
    """

    content: bytes
    packed: bytes
    media_type: str
    caching: str


@router.api_route("/", methods=_READ)
@router.api_route("/console", methods=_READ)
@public
async def show_console() -> Response:
    """Leads to the page, under whatever prefix a proxy puts before it."""
    _page()
    return RedirectResponse("console/", 307)


@router.api_route("/console/{path:path}", methods=_READ)
@public
async def get_console_file(path: str, request: Request) -> Response:
    """A file of the page.

    Raises:
        NotFound: there is no such file, or this installation has no console.
    """
    file = _page().get(path or INDEX)
    if file is None:
        raise NotFound("the console has no such file")
    headers = {**_HEADERS, "Cache-Control": file.caching}
    content = file.content
    if takes_gzip(request.headers.get("accept-encoding", "")):
        content, headers["Content-Encoding"] = file.packed, "gzip"
    return Response(content, media_type=file.media_type, headers=headers)


@cache
def page_files() -> dict[str, PageFile]:
    """The files of this installation. Read once: names in requests never touch the disk."""
    return read_page(FILES)


def read_page(folder: Path) -> dict[str, PageFile]:
    """The page's files in a folder, by name; none where there is no folder."""
    found = {}
    for path in sorted(folder.rglob("*")):
        if path.is_file():
            content, name = path.read_bytes(), path.relative_to(folder).as_posix()
            media_type = MEDIA_TYPES.get(path.suffix, "application/octet-stream")
            # the names of the assets hold a hash of their content
            caching = FOREVER if name.startswith("assets/") else _NEVER
            found[name] = PageFile(content, gzip.compress(content, 9, mtime=0), media_type, caching)
    return found


def takes_gzip(accept_encoding: str) -> bool:
    """Whether the value of an Accept-Encoding header allows gzip (RFC 9110)."""
    weights = {}
    for item in accept_encoding.lower().split(","):
        name, _, parameter = item.partition(";")
        weight = parameter.strip().removeprefix("q=").strip()
        weights[name.strip()] = weight.strip("0.") != "" if parameter else True
    return weights.get("gzip", weights.get("*", False))


def _page() -> dict[str, PageFile]:
    found = page_files()
    if not found:
        raise NotFound("this installation has no console: build it with `make console`")
    return found
