"""Numbered objects of a folder, ``000001.json`` and on, of which the newest matter."""

from __future__ import annotations

import re

from .store import Store, StoredObject

_NAME = re.compile(r"(\d+)\.json")
_NEAR_THE_END = 10_000  # of the numbers of one width


def number_of(key: str) -> int | None:
    """The number that an object is named by; None: it is named otherwise."""
    match = _NAME.fullmatch(key.rsplit("/", 1)[-1])
    return None if match is None else int(match[1])


def scan_after(store: Store, folder: str, number: int, *, digits: int = 6) -> dict[int, StoredObject]:
    """The folder's objects with a higher number, in order. The store is asked for those alone, however many
    there are below.

    Args:
        digits: that names have at least. Names of one width sort as their numbers do; near the end of the
            width and beyond it the whole folder is listed.
    """
    few = 0 < number < 10**digits - _NEAR_THE_END
    after = f"{folder}/{number:0{digits}d}.json" if few else None
    own = len(folder) + 1  # folders below are others' matter
    items = (item for item in store.scan(folder, after=after) if "/" not in item.key[own:])
    found = {number_of(item.key): item for item in items}
    return {seen: found[seen] for seen in sorted(n for n in found if n is not None and n > number)}
