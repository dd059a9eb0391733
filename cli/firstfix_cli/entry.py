"""Entry point of the program ``firstfix``: says what is missing where the command line cannot be loaded."""

from __future__ import annotations

import sys

from firstfix.errors import pip_install


def run() -> None:
    """Run the command line.

    Raises:
        SystemExit: always, with the exit code; 2 if a package of the command line is not installed.
    """
    try:
        from .main import run as run_command_line
    except ModuleNotFoundError as error:
        if (error.name or "").startswith("firstfix"):
            raise  # a fault of ours
        commands = pip_install(".[gateway]", ".[service]")
        print(f"firstfix: the command line needs {error.name}: {commands}", file=sys.stderr)
        raise SystemExit(2) from None
    run_command_line()
