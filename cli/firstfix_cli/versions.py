"""Versions by the first characters of their name, as people type them."""

from __future__ import annotations

from collections.abc import Iterable

from firstfix.errors import InvalidOption, NotFound

MIN_PREFIX_CHARS = 8
VERSION_CHARS = 64


def full_version(prefix: str, versions: Iterable[str]) -> str:
    """The one version that begins so.

    Raises:
        InvalidOption: fewer than 8 characters, or several versions begin so.
        NotFound: none does.
    """
    if len(prefix) < MIN_PREFIX_CHARS:
        raise InvalidOption(f"a version needs at least {MIN_PREFIX_CHARS} characters, not {prefix!r}")
    found = [version for version in versions if version.startswith(prefix.lower())]
    if not found:
        raise NotFound(f"no version begins with {prefix!r}")
    if len(found) > 1:
        raise InvalidOption(f"{len(found)} versions begin with {prefix!r}: give more characters")
    return found[0]
