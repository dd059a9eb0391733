"""Signatures of scan formats: what the first bytes of a body say where its media type says nothing."""

from __future__ import annotations

from ..errors import MalformedData, UnsupportedFormat
from .file_kind import SNIFFED_BYTES, kind_of
from .pcd import HEADER_KEYS
from .point_cloud import Body

# Of PointCloud2 the little-endian form alone: the other order begins with zeros, as raw points may.
_MAGIC = {
    b"FFSC": "application/vnd.firstfix.scan",
    b"FFSS": "application/vnd.firstfix.scans",
    b"FFQY": "application/vnd.firstfix.query",
    b"# .PCD": "application/x-pcd",
    b"ply": "application/ply",
    b"\x93NUMPY": "application/x-npy",
    b"LASF": "application/vnd.las",
    b"\0\1\0\0": "application/vnd.ros2.cdr",
}
_COMPRESSED = {b"\x1f\x8b": "gzip", b"\x28\xb5\x2f\xfd": "zstd"}

# What curl -d takes out, nobody can bring back.
_LONG_ENOUGH = 1000  # bytes: so many without CR, LF and zero are none of a scan
STRIPPED = "It has no line end and no zero byte, as curl's -d takes them out: send it by --data-binary"


def media_type_of(body: Body) -> str:
    """The media type of a body without its content encoding, by its first bytes.

    Raises:
        MalformedData: the body is empty.
        UnsupportedFormat: they are of no format of scans, or of one without a signature, as raw rows are.
    """
    head = bytes(body[:SNIFFED_BYTES])
    if not head:
        raise MalformedData("the body is empty (0 bytes): send the bytes of a scan")
    found = next((name for magic, name in _MAGIC.items() if head.startswith(magic)), None)
    if found is not None:
        return found
    if _first_word(head) in HEADER_KEYS:
        return "application/x-pcd"
    kind = kind_of(head)
    if kind == "text":
        return "text/plain"
    coding = next((name for magic, name in _COMPRESSED.items() if head.startswith(magic)), None)
    if coding is not None:
        raise UnsupportedFormat(f"the body is compressed by {coding}: say so by Content-Encoding: {coding}")
    raise UnsupportedFormat(
        f"the body does not say which format of scans it is, nor does its media type: it is {kind}. "
        "Rows of float32 without a header need one that says it, as in curl -H "
        "'Content-Type: application/vnd.firstfix.xyz' (n x 3) or application/vnd.firstfix.xyzi (n x 4). "
        f"Others are told by their first bytes: {', '.join(_MAGIC.values())}, text/csv"
    )


def _first_word(head: bytes) -> str:
    """The first word that is no comment, as a PCD's header has it."""
    lines = (line.split() for line in head.splitlines())
    first = next((words[0] for words in lines if words and not words[0].startswith(b"#")), b"")
    return first.decode("latin-1").upper()


def is_stripped(data: bytes | memoryview) -> bool:
    """Whether all CR, LF and zero bytes were taken out of data that cannot be read."""
    head = bytes(data[:_LONG_ENOUGH])
    is_header = head[:6] == b"# .PCD" or head[:3] == b"ply"
    return (is_header or len(head) == _LONG_ENOUGH) and not any(byte in head for byte in b"\r\n\0")
