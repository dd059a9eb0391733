"""Real kinds of files that have another one's name, told by their first bytes."""

from __future__ import annotations

from .point_cloud import Body

_KINDS = {
    b"\x89PNG": "a PNG image",
    b"\xff\xd8\xff": "a JPEG image",
    b"%PDF": "a PDF document",
    b"PK\x03\x04": "a ZIP archive",
    b"\x1f\x8b": "compressed by gzip",
    b"\x93NUMPY": "an .npy array",
    b"LASF": "a LAS or LAZ file",
    b"ASTM-E57": "an E57 file",
    b"#ROSBAG": "a ROS 1 bag: `firstfix localize --bag` takes it",
    b"\x89MCAP0\r\n": "an .mcap recording: `firstfix localize --bag` takes it",
    b"SQLite format 3": "an SQLite database",
}
SNIFFED_BYTES = 512


def kind_of(body: Body) -> str:
    """True kind of a file, in words."""
    head = bytes(body[:SNIFFED_BYTES])
    known = next((kind for magic, kind in _KINDS.items() if head.startswith(magic)), None)
    if known is not None:
        return known
    return "text" if head.isascii() and b"\0" not in head else "of an unknown kind"
