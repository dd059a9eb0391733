"""Question before something is destroyed."""

from __future__ import annotations

import sys

import typer

from firstfix.errors import InvalidOption


def confirm(what: str, *, force: bool) -> None:
    """Ask whether to go on, unless it is forced.

    Args:
        what: in the imperative.

    Raises:
        InvalidOption: there is no terminal to ask at.
        typer.Abort: the answer is no.
    """
    if force:
        return
    if not sys.stdin.isatty():
        raise InvalidOption(f"to {what} without a terminal to ask at, give --force")
    typer.confirm(f"{what[:1].upper()}{what[1:]}?", abort=True)
