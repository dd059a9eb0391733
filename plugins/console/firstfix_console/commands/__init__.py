"""Commands of the shell that make files for viewers."""

from __future__ import annotations

import typer

from . import export


def add_commands(app: typer.Typer) -> None:
    """Add the console's commands to ``firstfix``."""
    app.command(epilog=export.EXAMPLES)(export.export)
