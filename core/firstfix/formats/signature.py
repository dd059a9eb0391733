"""Signatures of scan formats: what the first bytes of a body say where its media type says nothing."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from ..errors import InputError, MalformedData, UnsupportedFormat
from .file_kind import kind_of
from .pcd import HEADER_KEYS

Begins = Callable[[bytes], bool]
_COMPRESSED = {b"\x1f\x8b": "gzip", b"\x28\xb5\x2f\xfd": "zstd"}
_RAW = (
    "Rows of float32 without a header need one that says it, as in curl -H "
    "'Content-Type: application/vnd.firstfix.xyz' (n x 3) or application/vnd.firstfix.xyzi (n x 4)"
)


def begins_with(magic: bytes) -> Begins:
    """The test for a format that begins with these bytes."""
    return lambda head: head.startswith(magic)


def begins_as_pcd(head: bytes) -> bool:
    """Whether these are the first lines of a PCD: its comment, or one of its keywords."""
    if head.startswith(b"# .PCD"):
        return True
    lines = (line.split() for line in head.splitlines())
    first = next((words[0] for words in lines if words and not words[0].startswith(b"#")), b"")
    return first.decode("latin-1").upper() in HEADER_KEYS


def begins_as_text(head: bytes) -> bool:
    """Whether these bytes are text."""
    return bool(head) and kind_of(head) == "text"


def no_signature(head: bytes, media_types: Iterable[str]) -> InputError:
    """The error for a body whose first bytes are of no format.

    Args:
        media_types: those that may be named in place of a signature.
    """
    if not head:
        return MalformedData("the body is empty (0 bytes): send the bytes of a scan")
    coding = next((name for magic, name in _COMPRESSED.items() if head.startswith(magic)), None)
    if coding is not None:
        return UnsupportedFormat(f"the body is compressed by {coding}: say so by Content-Encoding: {coding}")
    return UnsupportedFormat(
        f"the body does not say which format of scans it is, nor does its media type: it is {kind_of(head)}. "
        f"{_RAW}. Others: {', '.join(media_types)}"
    )
