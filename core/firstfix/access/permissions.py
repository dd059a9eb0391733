"""Permissions of a caller: scopes, on maps whose ids match patterns."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum
from fnmatch import fnmatchcase
from functools import cached_property

from ..errors import InvalidOption

_PATTERN = re.compile(r"[a-z0-9_*?-]{1,63}")  # characters of map ids and two wildcards, without fnmatch's []
MAX_PATTERNS = 100
ALL_MAPS = ("*",)


class Scope(str, Enum):
    """Kind of requests that a caller may make.

    Attributes:
        LOCALIZE: ask for poses, list maps and versions.
        BUILD: submit maps, follow and cancel builds, choose the active version. Includes LOCALIZE.
        METRICS: read /metrics and nothing else, for a monitor.
        ADMIN: everything.
    """

    LOCALIZE = "localize"
    BUILD = "build"
    METRICS = "metrics"
    ADMIN = "admin"


_INCLUDED: dict[Scope, frozenset[Scope]] = {
    Scope.LOCALIZE: frozenset({Scope.LOCALIZE}),
    Scope.BUILD: frozenset({Scope.BUILD, Scope.LOCALIZE}),
    Scope.METRICS: frozenset({Scope.METRICS}),
    Scope.ADMIN: frozenset(Scope),
}


@dataclass(frozen=True)
class Grant:
    """Granted scopes, without those that they include, and patterns of map ids.

    In a pattern ``*`` matches any characters and ``?`` one character.
    """

    scopes: frozenset[Scope]
    maps: tuple[str, ...] = ALL_MAPS

    @classmethod
    def parse(cls, scopes: Iterable[str], maps: Iterable[str]) -> Grant:
        """Parse scopes and patterns.

        Raises:
            InvalidOption: there is no scope or an unknown one; or no, too many or an invalid pattern.
        """
        named, patterns = list(scopes), tuple(dict.fromkeys(maps))
        known = {scope.value for scope in Scope}
        unknown = [name for name in named if name not in known]
        if unknown or not named:
            wrong = f", not {unknown[0][:40]!r}" if unknown else ""
            raise InvalidOption(f"a scope is one of {', '.join(sorted(known))}{wrong}")
        for pattern in patterns:
            if not _PATTERN.fullmatch(pattern):
                raise InvalidOption(
                    f"a pattern of map ids has only a-z, 0-9, _, -, * and ?, unlike {pattern[:80]!r}"
                )
        if not 0 < len(patterns) <= MAX_PATTERNS:
            raise InvalidOption(f"1 to {MAX_PATTERNS} patterns of map ids are expected")
        return cls(frozenset(Scope(name) for name in named), patterns)

    def allows(self, scope: Scope) -> bool:
        """Whether a granted scope is or includes this one."""
        return scope in self._allowed

    def covers(self, map_id: str) -> bool:
        """Whether a pattern matches the map's id. The map need not exist."""
        return "*" in self.maps or any(fnmatchcase(map_id, pattern) for pattern in self.maps)

    @cached_property
    def _allowed(self) -> frozenset[Scope]:
        return frozenset().union(*(_INCLUDED[given] for given in self.scopes))
