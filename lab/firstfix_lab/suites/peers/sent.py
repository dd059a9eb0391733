"""Bytes that a robot sends for one answer, when the peer runs elsewhere."""

from __future__ import annotations

from firstfix.scan.scan import Scan
from firstfix_client.steps.scan_body import BodyForm, encoded

from .peer_input import PeerInput

POINT_BYTES = 12  # x, y, z as float32


def points_bytes(given: PeerInput, scan: Scan) -> int:
    """Of the points that a peer without a wire format gets."""
    return POINT_BYTES * len(given.cropped(scan))


def encoded_bytes(given: PeerInput, scan: Scan) -> int:
    """Of a scan as firstfix's client sends it by default."""
    return len(encoded(scan, BodyForm())[1])
