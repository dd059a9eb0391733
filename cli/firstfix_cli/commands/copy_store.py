"""``firstfix copy-store``: back up a store, or restore it."""

from __future__ import annotations

import json
from typing import Annotated

import typer

from ..arguments import AsJson, examples

From = Annotated[
    str, typer.Argument(metavar="FROM", help="Store to read: a directory, s3://..., gs://... or az://...")
]
To = Annotated[str, typer.Argument(metavar="TO", help="Store to write: empty, or an earlier copy of FROM.")]


EXAMPLES = examples(
    "firstfix copy-store s3://maps/firstfix /backup/firstfix",
    "firstfix copy-store /backup/firstfix s3://maps/firstfix",
)


def copy_store(source: From, target: To, as_json: AsJson = False) -> None:
    """Copy a store: to back up, restore or move it.

    Maps, builds and API keys are copied. Both stores may be in use. Every file is checked. Damaged files are
    reported and not copied, and the exit code is then 2.
    """
    from firstfix.errors import CorruptVersion
    from firstfix.store.store import Store
    from firstfix.upkeep.backup import copy_store as copy

    report = copy(Store.open(source, read_only=True), Store.open(target))
    if as_json:
        found = {"objects": report.objects, "bytes": report.bytes, "damaged": report.damaged}
        typer.echo(json.dumps(found))
    else:
        typer.echo(f"{report.objects:,} objects copied, {report.bytes / 1e6:,.1f} MB")
    if report.damaged:
        raise CorruptVersion(f"damaged in {source}, not copied: {', '.join(report.damaged)}")
