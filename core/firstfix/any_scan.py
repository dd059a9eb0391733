"""All that a query may hold."""

from __future__ import annotations

from typing import TypeAlias

from .compact_scan import CompactScan, ScanDescriptor
from .scan import Scan
from .scan_sequence import ScanSequence

AnyScan: TypeAlias = "Scan | ScanSequence | CompactScan | ScanDescriptor"
