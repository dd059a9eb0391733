"""``firstfix copy-store``: back up a store, or restore it."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import Annotated

import typer

from ..arguments import AsJson, examples

From = Annotated[
    str, typer.Argument(metavar="FROM", help="Store to read: a directory, s3://..., gs://... or az://...")
]
To = Annotated[str, typer.Argument(metavar="TO", help="Store to write: empty, or an earlier copy of FROM.")]


DAMAGE_EXIT_CODE, CONFLICT_EXIT_CODE = 2, 5
EXAMPLES = examples(
    "firstfix copy-store s3://maps/firstfix /backup/firstfix",
    "firstfix copy-store /backup/firstfix s3://maps/firstfix",
)


def copy_store(source: From, target: To, as_json: AsJson = False) -> None:
    """Copy a store: to back up, restore or move it.

    Maps, builds and API keys are copied. Both stores may be in use. Every file is checked. Damaged files are
    reported and not copied, and the exit code is then 2. A map that has another history in TO is left out,
    and the exit code is then 5.
    """
    from firstfix.maintenance.backup import copy_store as copy
    from firstfix.store.store import Store
    from firstfix.telemetry.redact import redact

    from ..stores import existing_store

    report = copy(existing_store(source, read_only=True), Store.open(target))
    if as_json:
        typer.echo(json.dumps(asdict(report)))
    else:
        typer.echo(f"{report.objects:,} objects copied, {report.bytes / 1e6:,.1f} MB")
    for why, keys in (
        (f"damaged in {source}, not copied", report.damaged),
        (f"{target} has other content, which is not a copy of {source}", report.conflicts),
    ):
        if keys:
            typer.echo(redact(f"firstfix: {why}: {', '.join(keys)}"), err=True)
    if report.conflicts or report.damaged:
        raise typer.Exit(CONFLICT_EXIT_CODE if report.conflicts else DAMAGE_EXIT_CODE)
