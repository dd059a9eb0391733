"""All that a query may hold."""

from __future__ import annotations

from typing import TypeAlias

from .compact import CompactScan, ScanDescriptor
from .scan import Scan
from .sequence import ScanSequence

AnyScan: TypeAlias = "Scan | ScanSequence | CompactScan | ScanDescriptor"
