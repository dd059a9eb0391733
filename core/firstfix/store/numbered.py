"""Numbered objects of a folder: ``000001.json``, ``000002.json``, ..."""

from __future__ import annotations

import re

from .store import Store, StoredObject

_NAME = re.compile(r"(\d+)\.json")
_NEAR_THE_END = 10_000  # to the first number with one more digit


def number_of(key: str) -> int | None:
    """Number in an object's name, or None if it has no such name."""
    match = _NAME.fullmatch(key.rsplit("/", 1)[-1])
    return None if match is None else int(match[1])


def scan_after(store: Store, folder: str, number: int, *, digits: int = 6) -> dict[int, StoredObject]:
    """Objects of a folder with a higher number, in order. Lists only those, however many lower ones exist.

    Args:
        digits: least number of digits in a name. Names of equal length sort like their numbers; close to
            the first longer name, and beyond it, the whole folder is listed.
    """
    few = 0 < number < 10**digits - _NEAR_THE_END
    after = f"{folder}/{number:0{digits}d}.json" if few else None
    own = len(folder) + 1  # not those of folders below
    items = (item for item in store.scan(folder, after=after) if "/" not in item.key[own:])
    found = {number_of(item.key): item for item in items}
    return {seen: found[seen] for seen in sorted(n for n in found if n is not None and n > number)}
