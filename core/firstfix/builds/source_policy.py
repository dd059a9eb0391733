r"""Policy for URLs of sources that callers may name.

By default no URL is allowed: a service that fetches any URL gives access to the network behind it.

Servers read unusual paths in different ways. One decodes ``%2e%2e`` before it looks for the file, another
takes ``..;`` or ``\`` for a step up. So a URL is allowed only if there is just one way to read it.
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
    """The URL if it is below an allowed prefix: same scheme, same host, path within.

    Raises:
        InvalidOption: it is not, or it can be read in more than one way.
    """
    parts = _split(url)
    if parts.username is not None or parts.password is not None:
        raise InvalidOption("a source URL must not contain secrets")
    if parts.fragment or (parts.query and parts.scheme not in ("http", "https")):
        # the query of a store URL names its endpoint, which only the operator may choose
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
    """Decode a path that every server reads in the same way.

    Raises:
        InvalidOption: servers could read the path differently.
    """
    for escape in _ESCAPE.finditer(path):
        if escape[1] is None or int(escape[1], 16) in _NEVER_ENCODED:
            raise InvalidOption(f"the path of a source URL must not encode {escape[0]!r}")
    try:
        plain = unquote_to_bytes(path).decode("utf-8")
    except UnicodeDecodeError:
        raise InvalidOption("the path of a source URL must be UTF-8") from None
    folded = unicodedata.normalize("NFKC", plain)  # a full-width dot or slash becomes a plain one
    if len(re.findall(r"[./\\;%]", folded)) != len(re.findall(r"[./\\;%]", plain)) or ";" in plain:
        raise InvalidOption("the path of a source URL has a character that some servers read as another")
    segments = plain.split("/")[1:]
    if any(segment in (".", "..") for segment in segments) or "" in segments[:-1]:
        raise InvalidOption("a source URL must not have '.', '..' or empty parts in its path")
    return plain
