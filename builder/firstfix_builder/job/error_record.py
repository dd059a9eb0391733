"""The record of a failed build: code and detail, without paths of this machine."""

from __future__ import annotations

import errno
import shutil
from pathlib import Path

from firstfix.errors import BuildFailed, FirstfixError, OutOfSpace

MEMORY_REACHED = "the build needs more memory than it may take (FIRSTFIX_BUILD_MAX_MEMORY_BYTES)"


def error_record(error: Exception, work: Path) -> dict[str, str]:
    """Returns code and detail of a failure. Callers read them, so they name no path of this machine."""
    if isinstance(error, FirstfixError):
        return {"code": error.code, "detail": str(error).replace(str(work), "work")[:1000]}
    if isinstance(error, MemoryError):
        return {"code": BuildFailed.code, "detail": MEMORY_REACHED}
    if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT):
        return {"code": OutOfSpace.code, "detail": f"the work disk is full: {_free(work)} bytes are left"}
    if isinstance(error, OSError) and error.errno == errno.EFBIG:
        return {"code": BuildFailed.code, "detail": "a file of the build became larger than it may"}
    return {"code": FirstfixError.code, "detail": f"{type(error).__name__}: see the worker's log"}


def _free(folder: Path) -> int:
    """Bytes that the disk of a folder, or of the nearest one that is there, has left."""
    return shutil.disk_usage(next(one for one in (folder, *folder.absolute().parents) if one.exists())).free
