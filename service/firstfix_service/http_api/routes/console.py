"""/console/: the console's page. Its files are part of the package, and it asks no other host."""

from __future__ import annotations

import gzip
import mimetypes
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Annotated

from fastapi import APIRouter, Header, Response
from fastapi.responses import RedirectResponse

from firstfix.errors import NotFound

from ..cache_headers import FOREVER

router = APIRouter(include_in_schema=False)
FILES = Path(__file__).parents[2] / "console_files"
INDEX = "index.html"
_NEVER = "no-cache"  # asked for again each time: it names the files of this release
_HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; "
    "img-src 'self' data: blob:; connect-src 'self'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Vary": "Accept-Encoding",
}


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


@router.get("/")
@router.get("/console")
async def show_console() -> Response:
    """Leads to the page, under whatever prefix a proxy puts before it."""
    return RedirectResponse("console/", 307)


@router.get("/console/{name:path}")
async def get_console_file(name: str, accept_encoding: Annotated[str, Header()] = "") -> Response:
    """A file of the page.

    Raises:
        NotFound: there is no such file, or this installation has no console.
    """
    found = page_files()
    if not found:
        raise NotFound("this installation has no console: build it with `make console`")
    file = found.get(name or INDEX)
    if file is None:
        raise NotFound("the console has no such file")
    headers = {**_HEADERS, "Cache-Control": file.caching}
    if "gzip" in accept_encoding:
        return Response(
            file.packed, media_type=file.media_type, headers={**headers, "Content-Encoding": "gzip"}
        )
    return Response(file.content, media_type=file.media_type, headers=headers)


@cache
def page_files() -> dict[str, PageFile]:
    """The files by name. Read once: names in requests never touch the disk."""
    found = {}
    for path in sorted(FILES.rglob("*")):
        if path.is_file():
            content, name = path.read_bytes(), path.relative_to(FILES).as_posix()
            media_type = mimetypes.guess_type(name)[0] or "application/octet-stream"
            # the names of the assets hold a hash of their content
            caching = FOREVER if name.startswith("assets/") else _NEVER
            found[name] = PageFile(content, gzip.compress(content, 9, mtime=0), media_type, caching)
    return found
