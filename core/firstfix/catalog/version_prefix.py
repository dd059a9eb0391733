"""Versions given by their first characters, as in git and docker: the one place that decides."""

from __future__ import annotations

import re
from collections.abc import Iterable

from ..errors import InvalidOption, NotFound

MIN_PREFIX_CHARS = 4  # as in git
_VERSION_CHARS = 64
_PREFIX = re.compile(rf"[0-9a-f]{{{MIN_PREFIX_CHARS},{_VERSION_CHARS}}}")


def check_prefix(given: str) -> str:
    """A well-formed version, or the first characters of one, in lower case.

    Raises:
        InvalidOption: not 4 to 64 hex characters.
    """
    prefix = given.lower()
    if not _PREFIX.fullmatch(prefix):
        raise InvalidOption(
            f"not a map version, nor {MIN_PREFIX_CHARS} or more of its first characters: {given[:80]!r}"
        )
    return prefix


def full_version(given: str, versions: Iterable[str]) -> str:
    """The only version that begins with the given characters. A whole version is returned as it is.

    Raises:
        InvalidOption: as ``check_prefix``, or several versions begin so.
        NotFound: no version begins so.
    """
    prefix = check_prefix(given)
    if len(prefix) == _VERSION_CHARS:
        return prefix
    found = [version for version in versions if version.startswith(prefix)]
    if not found:
        raise NotFound(f"no version begins with {prefix}")
    if len(found) > 1:
        names = " and ".join(version[: len(prefix) + 4] for version in found[:2])
        raise InvalidOption(
            f"{len(found)} versions begin with {prefix}, such as {names}: give more characters"
        )
    return found[0]
