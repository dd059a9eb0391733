"""Which URLs a caller may have fetched. None by default: a service that fetches anything is a way into
the network behind it.

Servers differ in how they read an odd path: one decodes ``%2e%2e`` before it looks for the file, the next
takes ``..;`` or ``\\`` for a step up. So a URL is allowed only when there is one way to read it.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable
from urllib.parse import SplitResult, unquote_to_bytes, urlsplit

from ..errors import InvalidOption

MAX_URL_CHARS = 2000
_ESCAPE = re.compile(r"%([0-9A-Fa-f]{2})?")
_UNRESERVED = frozenset(b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789-._~")
_NEVER_ENCODED = _UNRESERVED | frozenset(b"/\\%;") | frozenset(range(0x20)) | {0x7F}


def check_source_url(url: str, allowed: Iterable[str]) -> str:
    """The URL itself, when it lies below an allowed prefix: same scheme, same host, path within.

    Raises:
        InvalidOption: it does not, or it can be read in more than one way.
    """
    parts = _split(url)
    if parts.username is not None or parts.password is not None:
        raise InvalidOption("a source URL holds no secrets")
    if parts.fragment or (parts.query and parts.scheme not in ("http", "https")):
        # a store URL's query names its endpoint: that is the operator's to choose
        raise InvalidOption("a source URL of an object store has no query")
    path = _plain_path(parts.path)
    for prefix in allowed:
        base = _split(prefix)
        base_path = _plain_path(base.path)
        folder = base_path if base_path.endswith("/") else f"{base_path}/"
        same_place = (parts.scheme, parts.netloc.lower()) == (base.scheme, base.netloc.lower())
        if same_place and (path == base_path or path.startswith(folder)):
            return url
    raise InvalidOption(f"this service does not fetch {url[:200]!r}: the operator has not allowed it")


def _split(url: str) -> SplitResult:
    if len(url) > MAX_URL_CHARS or not url.isprintable() or any(c.isspace() or c == "\\" for c in url):
        raise InvalidOption(f"not a URL: {url[:200]!r}")
    try:
        parts = urlsplit(url)
        _ = parts.port
    except ValueError as error:
        raise InvalidOption(f"not a URL: {error}") from None
    if not parts.scheme or "://" not in url or not parts.netloc.isascii() or "%" in parts.netloc:
        raise InvalidOption(f"not a URL: {url[:200]!r}")
    return parts


def _plain_path(path: str) -> str:
    """The path decoded once. Every reader comes to the same: nothing is left to decode, to fold or to climb.

    Raises:
        InvalidOption: readers could differ about it.
    """
    for escape in _ESCAPE.finditer(path):
        if escape[1] is None or int(escape[1], 16) in _NEVER_ENCODED:
            raise InvalidOption(f"the path of a source URL does not encode {escape[0]!r}")
    try:
        plain = unquote_to_bytes(path).decode("utf-8")
    except UnicodeDecodeError:
        raise InvalidOption("the path of a source URL is UTF-8") from None
    folded = unicodedata.normalize("NFKC", plain)  # a full-width dot or slash becomes a plain one
    if len(re.findall(r"[./\\;%]", folded)) != len(re.findall(r"[./\\;%]", plain)) or ";" in plain:
        raise InvalidOption("the path of a source URL has a character that some servers read as another")
    segments = plain.split("/")[1:]
    if any(segment in (".", "..") for segment in segments) or "" in segments[:-1]:
        raise InvalidOption("a source URL does not climb, and has no empty part")
    return plain
