"""Pages whose files are part of a package: read and packed once, and they ask no other host."""

from __future__ import annotations

import gzip
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from fastapi import Request, Response

READ = ["GET", "HEAD"]
# Not those of the machine, which may know other names.
MEDIA_TYPES = {
    ".css": "text/css",
    ".html": "text/html",
    ".js": "text/javascript",
    ".svg": "image/svg+xml",
    ".txt": "text/plain",
    ".woff2": "font/woff2",
}
# Cache-Control of what never changes. Shared caches must not serve it: callers may need permission.
FOREVER = "private, max-age=31536000, immutable"
NEVER = "no-cache"  # asked for again each time: it names the files of this release
_HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; "
    "img-src 'self' data: blob:; connect-src 'self'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Vary": "Accept-Encoding",
}


@dataclass(frozen=True)
class PageFile:
    """One file of a page.

    Attributes:
        packed: the content with gzip.
        caching: the value of Cache-Control.
    """

    content: bytes
    packed: bytes
    media_type: str
    caching: str

    def answer(self, request: Request, headers: Mapping[str, str] = _HEADERS) -> Response:
        """The file as the answer to a request, packed where the caller takes that."""
        content, sent = self.content, {**headers, "Cache-Control": self.caching}
        if takes_gzip(request.headers.get("accept-encoding", "")):
            content, sent["Content-Encoding"] = self.packed, "gzip"
        return Response(content, media_type=self.media_type, headers=sent)


def page_file(path: Path, caching: str = NEVER) -> PageFile:
    """A file of the disk."""
    content = path.read_bytes()
    media_type = MEDIA_TYPES.get(path.suffix, "application/octet-stream")
    return PageFile(content, gzip.compress(content, 9, mtime=0), media_type, caching)


def takes_gzip(accept_encoding: str) -> bool:
    """Whether the value of an Accept-Encoding header allows gzip (RFC 9110)."""
    weights = {}
    for item in accept_encoding.lower().split(","):
        name, _, parameter = item.partition(";")
        weight = parameter.strip().removeprefix("q=").strip()
        weights[name.strip()] = weight.strip("0.") != "" if parameter else True
    return weights.get("gzip", weights.get("*", False))
