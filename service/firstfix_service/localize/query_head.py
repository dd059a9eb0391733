"""A query without its body: what its transport delivered."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class QueryHead:
    """All of a query except its body. Nothing in it was checked yet.

    Attributes:
        map_ids: maps to search; empty: all maps that the caller may see.
        media_type: of the body, with its parameters.
        content_encoding: of the body; None: not compressed.
        options: as text, see ``LocalizeOptions.from_strings``.
        arrived: ``time.monotonic`` when the query came. Its deadline counts from then.
    """

    map_ids: tuple[str, ...]
    media_type: str
    content_encoding: str | None
    options: Mapping[str, str]
    arrived: float = field(default_factory=time.monotonic)


def split_map_ids(maps: str) -> tuple[str, ...]:
    """Returns the ids in a ``map`` parameter: one, several separated by commas, or none."""
    return tuple(maps.split(",")) if maps else ()
