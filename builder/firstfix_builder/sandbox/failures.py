"""Reasons why a build failed, in words that may be shown: they name no path of this machine."""

from __future__ import annotations

import errno
import signal
from pathlib import Path
from typing import Any

from firstfix.errors import BuildCancelled, BuildFailed, FirstfixError, InputError, NotFound


def described(error: Exception, work: Path) -> dict[str, str]:
    """Code and detail of a failure, for people who must not see this machine's paths."""
    if isinstance(error, FirstfixError):
        return {"code": error.code, "detail": str(error).replace(str(work), "work")[:1000]}
    if isinstance(error, MemoryError):
        return {"code": BuildFailed.code, "detail": "the worker ran out of memory"}
    if isinstance(error, OSError) and error.errno == errno.ENOSPC:
        return {"code": BuildFailed.code, "detail": "the worker's disk is full"}
    if isinstance(error, OSError) and error.errno == errno.EFBIG:
        return {"code": BuildFailed.code, "detail": "a file of the build became larger than it may"}
    return {"code": FirstfixError.code, "detail": f"{type(error).__name__}: see the worker's log"}


def as_error(said: Any) -> FirstfixError:
    """The failure that a build in its sandbox told of. It cannot ask to be run again."""
    if not isinstance(said, dict):
        return BuildFailed("the build failed, and did not say why")
    code, detail = str(said.get("code")), str(said.get("detail"))[:1000]
    if code == FirstfixError.code:
        return FirstfixError(detail)  # a fault of the program itself: the log has it
    kinds: list[type[FirstfixError]] = [InputError, *InputError.__subclasses__(), NotFound, BuildCancelled]
    return next((kind for kind in kinds if kind.code == code), BuildFailed)(detail)


def of_exit(code: int, stage: str) -> BuildFailed:
    """Of a build's process that ended without a word."""
    if code < 0:
        return BuildFailed(f"the build's process was ended by {signal.Signals(-code).name} in {stage}")
    return BuildFailed(f"the build's process ended with exit code {code} in {stage}")
