"""Data that went through a transfer for text: FTP's ASCII mode, a file opened as text on Windows, curl's -d.

The first two make CR LF of each byte LF. It shows for certain: no LF is without a CR before it, and the data
is longer by one byte for each. Then taking out these CRs gives the data as it was. curl's option -d takes out
all CR, LF and zero bytes, which nobody can bring back.
"""

from __future__ import annotations

from ..errors import MalformedData

_FEWEST = 8  # bytes LF: fewer may have a CR before them by chance
_LONG_ENOUGH = 1000  # bytes: so many without CR, LF and zero are none of a scan
STRIPPED = "It has no line end and no zero byte, as curl's -d takes them out: send it by --data-binary"


def undo_text_mode(format_name: str, data: memoryview, need: int | None) -> memoryview:
    """The data as it was; itself, if it went through no such transfer.

    Args:
        need: bytes that the data must have; None: not known before it is mended.

    Raises:
        MalformedData: it went through one, and has another size when it is mended.
    """
    if len(data) == need:
        return data
    raw = bytes(data)
    ends = raw.count(b"\n")
    if raw.count(b"\r\n") < ends:
        return data
    if len(raw) - ends == need or (need is None and ends >= _FEWEST):
        return memoryview(raw.replace(b"\r\n", b"\n"))
    if need is not None and ends >= _FEWEST:
        raise MalformedData(
            f"{format_name}: the file is damaged by a text-mode transfer, which put a CR before each LF: "
            "copy it again as binary"
        )
    return data


def is_stripped(data: bytes | memoryview) -> bool:
    """Whether all CR, LF and zero bytes were taken out of data that cannot be read."""
    head = bytes(data[:_LONG_ENOUGH])
    is_header = head[:6] == b"# .PCD" or head[:3] == b"ply"
    return (is_header or len(head) == _LONG_ENOUGH) and not any(byte in head for byte in b"\r\n\0")
