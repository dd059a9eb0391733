"""The scan of a recorded query, which comes from a robot: bytes of strangers."""

from __future__ import annotations

from pathlib import Path

from firstfix.decode import decode_query
from firstfix.errors import InvalidScan, TooLarge
from firstfix.scan.compact import CompactScan
from firstfix.scan.scan import Scan
from firstfix.scan.sequence import ScanSequence
from firstfix.wire.content_encoding import undo_content_encoding

MAX_DECODED_BYTES = 64 << 20
MAX_POINTS = 1_000_000


def read_recorded_scan(
    path: Path, media_type: str, content_encoding: str, *, alone: bool = False
) -> Scan | CompactScan:
    """Read the body of a recorded query. Of several scans it is the last, whose pose the answer has.

    Args:
        alone: refuse a query of several scans.

    Raises:
        InputError: it is no scan, or too large.
    """
    body = undo_content_encoding(path.read_bytes(), content_encoding, MAX_DECODED_BYTES)
    scan = decode_query(body, media_type)
    if alone and isinstance(scan, ScanSequence) and len(scan) > 1:
        raise InvalidScan(f"it has {len(scan)} scans")
    last = scan.scans[-1] if isinstance(scan, ScanSequence) else scan
    if not isinstance(last, Scan | CompactScan):
        raise InvalidScan("it has a descriptor and no points")
    if len(last.points) > MAX_POINTS:
        raise TooLarge(f"it has {len(last.points)} points, the limit is {MAX_POINTS}")
    return last
