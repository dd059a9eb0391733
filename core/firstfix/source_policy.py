"""Which URLs a caller may have fetched. None by default: a service that fetches anything is a way into
the network behind it."""

from __future__ import annotations

from collections.abc import Iterable
from urllib.parse import SplitResult, unquote, urlsplit

from .errors import InvalidOption

MAX_URL_CHARS = 2000


def check_source_url(url: str, allowed: Iterable[str]) -> str:
    """The URL itself, when it lies below an allowed prefix: same scheme, same host, path within.

    Raises:
        InvalidOption: it does not, or it has parts that could lead elsewhere.
    """
    parts = _split(url)
    if parts.username is not None or parts.password is not None:
        raise InvalidOption("a source URL holds no secrets")
    if parts.fragment or (parts.query and parts.scheme not in ("http", "https")):
        # a store URL's query names its endpoint: that is the operator's to choose
        raise InvalidOption("a source URL of an object store has no query")
    if any(segment in (".", "..") for segment in unquote(parts.path).replace("\\", "/").split("/")):
        raise InvalidOption("a source URL does not climb")
    for prefix in allowed:
        base = _split(prefix)
        folder = base.path if base.path.endswith("/") else f"{base.path}/"
        same_place = (parts.scheme, parts.netloc.lower()) == (base.scheme, base.netloc.lower())
        if same_place and (parts.path == base.path or parts.path.startswith(folder)):
            return url
    raise InvalidOption(f"this service does not fetch {url[:200]!r}: the operator has not allowed it")


def _split(url: str) -> SplitResult:
    try:
        parts = urlsplit(url)
        _ = parts.port
    except ValueError as error:
        raise InvalidOption(f"not a URL: {error}") from None
    if not parts.scheme or len(url) > MAX_URL_CHARS or any(c.isspace() or not c.isprintable() for c in url):
        raise InvalidOption(f"not a URL: {url[:200]!r}")
    return parts
