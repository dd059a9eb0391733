"""Correction of one flipped bit in a record: its checksum tells which one it was."""

from __future__ import annotations

from functools import lru_cache

from .json_record import RecordKind, parse_record

MAX_BYTES = 2048  # every bit is tried: a larger record would take seconds


@lru_cache(64)  # a reader of a log meets the same damage again and again
def with_bit_restored(data: bytes, kind: RecordKind) -> bytes | None:
    """A damaged record as it was before one bit of it flipped.

    Returns:
        The record with a right checksum. None if the record is large, or no single bit explains the damage.
    """
    if len(data) > MAX_BYTES:
        return None
    tried = bytearray(data)
    for bit in range(8 * len(data)):
        tried[bit // 8] ^= 1 << bit % 8
        if _is_right(bytes(tried), kind):
            return bytes(tried)
        tried[bit // 8] ^= 1 << bit % 8
    return None


def _is_right(data: bytes, kind: RecordKind) -> bool:
    try:
        return parse_record(data, kind, lambda record: record is not None)
    except ValueError:
        return False
