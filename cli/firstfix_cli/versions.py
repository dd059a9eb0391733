"""Versions given by their first characters."""

from __future__ import annotations

from collections.abc import Iterable

from firstfix.errors import InvalidOption, NotFound

MIN_PREFIX_CHARS = 8


def full_version(prefix: str, versions: Iterable[str]) -> str:
    """The only version with this prefix.

    Raises:
        InvalidOption: fewer than 8 characters, or several versions have the prefix.
        NotFound: no version has the prefix.
    """
    if len(prefix) < MIN_PREFIX_CHARS:
        raise InvalidOption(f"give at least {MIN_PREFIX_CHARS} characters of a version, not {prefix!r}")
    found = [version for version in versions if version.startswith(prefix.lower())]
    if not found:
        raise NotFound(f"no version begins with {prefix!r}")
    if len(found) > 1:
        raise InvalidOption(f"{len(found)} versions begin with {prefix!r}: give more characters")
    return found[0]
