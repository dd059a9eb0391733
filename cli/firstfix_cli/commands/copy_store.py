"""``firstfix copy-store``: a backup, and its restoration."""

from __future__ import annotations

import json
from typing import Annotated

import typer

from ..arguments import AsJson

From = Annotated[str, typer.Argument(metavar="FROM", help="Store: a directory, s3://..., gs://..., az://...")]
To = Annotated[
    str, typer.Argument(metavar="TO", help="Store that is empty, or an earlier copy of the first.")
]


def copy_store(source: From, target: To, as_json: AsJson = False) -> None:
    """Copy maps, builds and API keys from one store to another: to back up, to restore, to move.

    Both may be in use. Files are checked on the way; those that are damaged are named, left out, and the
    exit code is 2.
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
