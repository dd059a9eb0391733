"""Names of objects, restricted to what every kind of store keeps unchanged."""

from __future__ import annotations

import re

from ..errors import InvalidOption

_SEGMENT = re.compile(r"[A-Za-z0-9_][A-Za-z0-9._-]{0,199}")
_MAX_KEY_CHARS = 900  # S3 allows 1024 with the prefix


def check_key(key: str) -> str:
    """The key if it is valid.

    Raises:
        InvalidOption: the key is absolute, contains '..', or has characters that some store changes.
    """
    if len(key) > _MAX_KEY_CHARS or not all(_SEGMENT.fullmatch(part) for part in key.split("/")):
        raise InvalidOption(f"not an object key: {key[:100]!r}")
    return key


def check_folder(prefix: str) -> str:
    """The folder without its last ``/``; empty for the whole store.

    Raises:
        InvalidOption: the folder is not a valid key.
    """
    folder = prefix.rstrip("/")
    return check_key(folder) if folder else ""
