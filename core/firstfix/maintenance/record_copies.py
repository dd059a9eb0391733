"""Comparison of one record in two stores: which copy is right where they differ."""

from __future__ import annotations

import json
from enum import Enum
from typing import Any

from ..store.json_record import CHECKSUM
from .record_kinds import why_unreadable


class Copies(Enum):
    """Two copies of one record."""

    ALIKE = "alike"  # they say the same
    TARGET_DAMAGED = "target_damaged"  # only the source's can be read, or only it has its checksum
    SOURCE_DAMAGED = "source_damaged"  # the source's cannot be read
    DIFFERENT = "different"  # both can be read, and neither is a damaged copy of the other


def compare_copies(key: str, source: bytes, target: bytes) -> Copies:
    """Compare the source's copy of a record with the target's.

    Snapshots of the same entries are alike even if they differ in the entries that their writers could not
    read.
    """
    if source == target:
        return Copies.ALIKE
    if why_unreadable(key, source) is not None:
        return Copies.SOURCE_DAMAGED
    if why_unreadable(key, target) is not None:
        return Copies.TARGET_DAMAGED
    ours, theirs = _values(key, source), _values(key, target)
    if ours is None or theirs is None:  # a georeference that was removed
        return Copies.DIFFERENT
    ours_checked, theirs_checked = (values.pop(CHECKSUM, None) is not None for values in (ours, theirs))
    if ours == theirs:
        return Copies.ALIKE
    # The name of a field may be damaged, that of the checksum too: then the record reads as if it had none.
    if ours_checked and not theirs_checked and _has_all_of(theirs, ours):
        return Copies.TARGET_DAMAGED
    if theirs_checked and not ours_checked and _has_all_of(ours, theirs):
        return Copies.ALIKE
    return Copies.DIFFERENT


def _has_all_of(record: dict[str, Any], values: dict[str, Any]) -> bool:
    return {name: record.get(name) for name in values} == values


def _values(key: str, data: bytes) -> dict[str, Any] | None:
    values: dict[str, Any] | None = json.loads(data)
    if values is not None and "/snapshots/" in key:
        values["skipped"] = []
    return values
