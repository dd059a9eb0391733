"""Memory that a build has freed goes back to the machine."""

from __future__ import annotations

import ctypes
from contextlib import suppress

LARGE_BYTES = 4 << 20  # smaller ones are many: to map each anew takes time
KEPT_BYTES = 32 << 20  # at a heap's end: what the next scan needs again is not given back in between
_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3  # of glibc's <malloc.h>


def return_large_blocks() -> None:
    """Have every large block of this process mapped by itself, so that it is the machine's again once freed.

    By itself glibc does so only until the first such block is freed. Then it keeps blocks of that size in
    the heaps of its threads, where small ones between them hold what is free: of a build's memory nine
    tenths. Other C libraries are left as they are.
    """
    with suppress(AttributeError, OSError):
        libc = ctypes.CDLL(None)
        libc.mallopt(_M_MMAP_THRESHOLD, LARGE_BYTES)
        libc.mallopt(_M_TRIM_THRESHOLD, KEPT_BYTES)
