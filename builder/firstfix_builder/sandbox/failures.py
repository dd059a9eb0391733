"""Conversion of the failure of a sandboxed build into an error of the worker outside."""

from __future__ import annotations

import signal
from typing import Any

from firstfix.errors import (
    BuildCancelled,
    BuildFailed,
    FirstfixError,
    InputError,
    NotFound,
    OutOfSpace,
)

_OTHER_KINDS: tuple[type[FirstfixError], ...] = (NotFound, BuildCancelled, OutOfSpace)


def as_error(said: Any) -> FirstfixError:
    """Returns the error that a sandboxed build reported.

    A build cannot ask to be run again, but for a few times because its disk is full.
    """
    if not isinstance(said, dict):
        return BuildFailed("the build failed and gave no reason")
    code, detail = str(said.get("code")), str(said.get("detail"))[:1000]
    if code == FirstfixError.code:
        return FirstfixError(detail)  # a fault of the program itself: the log has it
    kinds: list[type[FirstfixError]] = [InputError, *InputError.__subclasses__(), *_OTHER_KINDS]
    return next((kind for kind in kinds if kind.code == code), BuildFailed)(detail)


def of_exit(code: int, stage: str) -> BuildFailed:
    """Returns the error of a build whose process ended without a report."""
    if code < 0:
        return BuildFailed(f"the build's process was ended by {signal.Signals(-code).name} in {stage}")
    return BuildFailed(f"the build's process ended with exit code {code} in {stage}")
