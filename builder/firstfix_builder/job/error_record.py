"""The record of a failed build: code and detail, without paths of this machine."""

from __future__ import annotations

import errno
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from firstfix.errors import BuildFailed, FirstfixError, OutOfSpace

MEMORY_REACHED = "the build needs more memory than it may take (FIRSTFIX_BUILD_MAX_MEMORY_BYTES)"
_FULL = (errno.ENOSPC, errno.EDQUOT)


def error_record(error: Exception, work: Path) -> dict[str, str]:
    """Returns code and detail of a failure. Callers read them, so they name no path of this machine."""
    if isinstance(error, FirstfixError):
        return {"code": error.code, "detail": str(error).replace(str(work), "work")[:1000]}
    if isinstance(error, MemoryError):
        return {"code": BuildFailed.code, "detail": MEMORY_REACHED}
    if isinstance(error, OSError) and error.errno in _FULL:
        return {"code": OutOfSpace.code, "detail": _full_disk(work)}
    if isinstance(error, OSError) and error.errno == errno.EFBIG:
        return {"code": BuildFailed.code, "detail": "a file of the build became larger than it may"}
    return {"code": FirstfixError.code, "detail": f"{type(error).__name__}: see the worker's log"}


@contextmanager
def full_disk_named(work: Path) -> Iterator[None]:
    """Turns the error of a full disk into one that names the work disk, and its free bytes.

    Raises:
        OutOfSpace: the block met a full disk.
    """
    try:
        yield
    except OSError as error:
        if error.errno not in _FULL:
            raise
        raise OutOfSpace(_full_disk(work)) from error


def _full_disk(work: Path) -> str:
    folder = next(one for one in (work, *work.absolute().parents) if one.exists())
    return f"the work disk is full: {shutil.disk_usage(folder).free} bytes are left"
