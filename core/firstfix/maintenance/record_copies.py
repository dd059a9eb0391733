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
    TARGET_DAMAGED = "target_damaged"  # only the source's can be read
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
    return Copies.ALIKE if _values(key, source) == _values(key, target) else Copies.DIFFERENT


def _values(key: str, data: bytes) -> dict[str, Any] | None:
    values: dict[str, Any] | None = json.loads(data)
    if values is not None and "/snapshots/" in key:
        values |= {"skipped": [], CHECKSUM: ""}
    return values
