"""The map that a misspelt name most resembles."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from difflib import get_close_matches

from ..errors import NotFound

_LIKE = 0.7  # as of options: two names of five letters that differ in one are .8
_COMPARED = 200  # names, in some 4 ms: other callers wait while names are compared


def with_nearest(error: NotFound, map_ids: Callable[[], Iterable[str]]) -> NotFound:
    """The error that there is no map, with the map that was meant if one's name is much like it.

    Args:
        error: any other one is given back as it is.
        map_ids: gives the names of the maps that may be said. Only asked if a map was not found.
    """
    if not error.map_id:
        return error
    known = list(map_ids())
    near = get_close_matches(error.map_id, known, 1, cutoff=_LIKE) if len(known) <= _COMPARED else []
    return NotFound.of_map(error.map_id, near[0]) if near else error
