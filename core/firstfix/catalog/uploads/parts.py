"""Parts of an upload: objects named by the offset of their first byte, created once."""

from __future__ import annotations

import re
from collections.abc import Iterable

from ...errors import TooLarge
from ...ids import check_upload_id
from ...store.store import StoredObject

PART_BYTES = 16 << 20
MAX_PARTS = 10_000
_PART_NAME = re.compile(r"[0-9]{20}")


def upload_folder(upload_id: str) -> str:
    """Folder of an upload in the store.

    Raises:
        InvalidOption: the id is invalid.
    """
    return f"uploads/{check_upload_id(upload_id)}"


def part_key(upload_id: str, offset: int) -> str:
    """Key of the part that starts at an offset."""
    return f"{upload_folder(upload_id)}/parts/{offset:020d}"


def check_part_limits(size_bytes: int, *, count: int) -> None:
    """Check the size of a new part, and the number of parts that an upload has with it.

    Raises:
        TooLarge: the part is too large, or there are too many parts.
    """
    if size_bytes > PART_BYTES:
        raise TooLarge(f"a part of an upload has at most {PART_BYTES} bytes")
    if count > MAX_PARTS:
        raise TooLarge(f"an upload has at most {MAX_PARTS} parts: send larger ones")


def parts_in_order(found: Iterable[StoredObject], upload_id: str, size_bytes: int) -> tuple[int, ...]:
    """Sizes of the parts from the start up to the first gap, from a listing of the upload.

    A listing is not to be trusted. It can show names that are not offsets, and parts that are empty (after a
    power cut), overlap, or go beyond the announced size. The first such part ends the sequence.
    """
    prefix = f"{upload_folder(upload_id)}/parts/"
    sizes = {
        int(name): item.size_bytes
        for item in found
        if item.key.startswith(prefix) and _PART_NAME.fullmatch(name := item.key.removeprefix(prefix))
    }
    parts: list[int] = []
    offset = 0
    while len(parts) < MAX_PARTS and can_be_part(sizes.get(offset, 0), size_bytes - offset):
        parts.append(sizes[offset])
        offset += sizes[offset]
    return tuple(parts)


def can_be_part(size_bytes: int, left_bytes: int) -> bool:
    """Whether a part of this size is valid when ``left_bytes`` of the upload are missing."""
    return 0 < size_bytes <= min(PART_BYTES, left_bytes)
