"""The record of a failed build: code and detail, without paths of this machine."""

from __future__ import annotations

import errno
from pathlib import Path

from firstfix.errors import BuildFailed, FirstfixError


def error_record(error: Exception, work: Path) -> dict[str, str]:
    """Returns code and detail of a failure. Callers read them, so they name no path of this machine."""
    if isinstance(error, FirstfixError):
        return {"code": error.code, "detail": str(error).replace(str(work), "work")[:1000]}
    if isinstance(error, MemoryError):
        return {"code": BuildFailed.code, "detail": "the worker ran out of memory"}
    if isinstance(error, OSError) and error.errno == errno.ENOSPC:
        return {"code": BuildFailed.code, "detail": "the worker's disk is full"}
    if isinstance(error, OSError) and error.errno == errno.EFBIG:
        return {"code": BuildFailed.code, "detail": "a file of the build became larger than it may"}
    return {"code": FirstfixError.code, "detail": f"{type(error).__name__}: see the worker's log"}
