"""One build as a job: its inputs, its result, and the record of its failure."""

from __future__ import annotations

import errno
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

from firstfix.catalog.manifest import Manifest
from firstfix.errors import BuildFailed, FirstfixError, OutOfSpace

MEMORY_REACHED = "the build needs more memory than it may take (FIRSTFIX_BUILD_MAX_MEMORY_BYTES)"
_FULL = (errno.ENOSPC, errno.EDQUOT)


@dataclass(frozen=True)
class BuildResult:
    """A version that is ready to be published: every file in ``directory`` stands in the manifest."""

    directory: Path
    manifest: Manifest


@dataclass(frozen=True)
class BuildJob:
    """The inputs of one build on this machine.

    Attributes:
        source: the map's file.
        trajectory: poses of the mapping run, or None.
        config: the build's configuration as JSON.
        work: folder for stages and the version.
        progress: called with a stage's name and its completed share, 0..1.
        cancelled: returns whether the build is cancelled.
        publish_provisional: called with the provisional version when it is ready; None: none is made.
        confirmed: folder of confirmed queries (``confirmed_queries``), or None.
        base: folder of the version that the config names as its base (``base_source``), or None.
    """

    source: Path
    trajectory: Path | None
    config: dict[str, Any]
    work: Path
    progress: Callable[[str, float], None]
    cancelled: Callable[[], bool]
    publish_provisional: Callable[[BuildResult], None] | None = None
    confirmed: Path | None = None
    base: Path | None = None


BuildVersion: TypeAlias = Callable[[BuildJob], BuildResult]


def error_record(error: Exception, work: Path) -> dict[str, str]:
    """Code and detail of a failure. Callers read them, so they name no path of this machine."""
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
    """Turn the error of a full disk into one that names the work disk, and its free bytes.

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
