"""Decoders of point-cloud formats: bytes to columns, safe with bytes from strangers.

Every decoder checks what a header promises against the bytes that are there and against ``Limits`` before it
takes memory. What goes wrong is MalformedData, TooLarge or UnsupportedFormat, never another exception.
"""

from __future__ import annotations
