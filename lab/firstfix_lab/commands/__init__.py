"""Commands of the shell that evaluate and read data sets."""

from __future__ import annotations

import typer

from . import dataset, evaluate


def add_commands(app: typer.Typer) -> None:
    """Add the lab's commands to ``firstfix``."""
    app.command(epilog=evaluate.EXAMPLES)(evaluate.evaluate)
    app.command(epilog=dataset.EXAMPLES)(dataset.dataset)
