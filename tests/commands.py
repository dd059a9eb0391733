"""Commands of the command line, run in this process: for tests of what they say, not of their processes."""

from __future__ import annotations

import io
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass

import pytest


@dataclass(frozen=True)
class Said:
    """Texts of a command: on standard output, and on standard error."""

    out: str
    error: str


def firstfix(*arguments: object, code: int = 0) -> Said:
    """Runs a command and checks its exit code."""
    from firstfix_cli.main import run

    out, error = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(error), pytest.raises(SystemExit) as ended:
        run(list(map(str, arguments)))
    said = Said(out.getvalue(), error.getvalue())
    assert (ended.value.code or 0) == code, said
    return said
