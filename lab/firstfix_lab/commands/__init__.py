"""Commands of the shell that evaluate, read data sets and export."""

from __future__ import annotations

import typer

from . import dataset, evaluate, export


def add_commands(app: typer.Typer) -> None:
    """Add the lab's commands to ``firstfix``."""
    app.command(epilog=evaluate.EXAMPLES)(evaluate.evaluate)
    app.command(epilog=dataset.EXAMPLES)(dataset.dataset)
    app.command(epilog=export.EXAMPLES)(export.export)
