"""Binary data that went through a text-mode transfer: FTP's ASCII mode, or a file opened as text on Windows.

Each byte LF has become CR LF. It shows for certain: no LF is without a CR before it, and the data is longer
by one byte for each. Then taking out these CRs gives the data as it was.
"""

from __future__ import annotations

from ..errors import MalformedData

_FEWEST = 8  # bytes LF: fewer may have a CR before them by chance


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
