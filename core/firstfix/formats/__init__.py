"""Decoders of point-cloud formats: from bytes to columns. Safe for untrusted input.

Before it allocates memory, every decoder compares the sizes in the header with the size of the body and with
``Limits``. It raises MalformedData, TooLarge or UnsupportedFormat, and no other exception.
"""

from __future__ import annotations
