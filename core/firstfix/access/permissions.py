"""What a caller is allowed: some scopes, on the maps whose ids match some patterns."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum
from fnmatch import fnmatchcase

from ..errors import InvalidOption

_PATTERN = re.compile(r"[a-z0-9_*?-]{1,63}")  # a map id's letters and the two wildcards; no [] of fnmatch's
MAX_PATTERNS = 100
ALL_MAPS = ("*",)


class Scope(str, Enum):
    """
    Attributes:
        LOCALIZE: ask for poses, see which maps and versions there are.
        BUILD: hand in maps, follow and cancel builds, choose the version that answers. Includes LOCALIZE:
            who decides what robots are answered may as well ask.
        METRICS: read /metrics, for a monitor that needs nothing else.
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
    """Scopes as they were given (what they include is not spelled out), and patterns of map ids.

    In a pattern ``*`` stands for any characters and ``?`` for one; the rest for itself.
    """

    scopes: frozenset[Scope]
    maps: tuple[str, ...] = ALL_MAPS

    @classmethod
    def parse(cls, scopes: Iterable[str], maps: Iterable[str]) -> Grant:
        """
        Raises:
            InvalidOption: no or an unknown scope; no, too many or an impossible pattern.
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
                    f"a pattern of map ids is of a-z, 0-9, _, -, * and ?, not {pattern[:80]!r}"
                )
        if not 0 < len(patterns) <= MAX_PATTERNS:
            raise InvalidOption(f"1 to {MAX_PATTERNS} patterns of map ids are expected")
        return cls(frozenset(Scope(name) for name in named), patterns)

    def allows(self, scope: Scope) -> bool:
        return any(scope in _INCLUDED[given] for given in self.scopes)

    def covers(self, map_id: str) -> bool:
        """Whether the map is one of those that the patterns name. Never asks whether it exists."""
        return any(fnmatchcase(map_id, pattern) for pattern in self.maps)
