"""``firstfix export``: write a map with its recorded queries as a file for viewers."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from firstfix_cli.arguments import AsJson, MapId, Store, Url, examples

EXAMPLES = examples(
    "firstfix export hall.mcap --map hall",
    "firstfix export hall.rrd --map hall --store s3://maps/firstfix --count 200",
)
MAX_POINTS = 10_000_000


def export(
    out: Annotated[Path, typer.Argument(metavar="FILE", help="File to write: .mcap or .rrd.")],
    map_id: MapId,
    url: Url = None,
    store: Store = None,
    recorded: Annotated[
        str | None,
        typer.Option(
            metavar="STORE",
            help="With --store: store of the recorded queries, if they have one of their own.",
        ),
    ] = None,
    version: Annotated[
        str | None,
        typer.Option(
            help="Version whose cloud is written, or its first characters [default: the active one]."
        ),
    ] = None,
    points: Annotated[
        int, typer.Option(help="Limit on the points of the map.", min=1, max=MAX_POINTS)
    ] = 2_000_000,
    count: Annotated[
        int | None, typer.Option(help="Only the newest so many recorded queries [default: all].", min=0)
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace a file that is there.")] = False,
    as_json: AsJson = False,
    samples: Annotated[str | None, typer.Option(hidden=True, help="Gone: --recorded.")] = None,
) -> None:
    """Write a map with its recorded queries for viewers.

    An .mcap file is for Foxglove, rerun and ROS 2, an .rrd file for rerun alone. It holds the map's points,
    the templates, the mapping run, and of every recorded query the scan at the answered pose, the
    hypotheses, the truth where somebody has told it, and the verdict in words.
    """
    from firstfix.errors import InvalidOption

    from ..export.export import export as write
    from ..export.source import export_source

    if samples is not None:  # until 0.2
        raise InvalidOption("--samples is now: --recorded")
    with export_source(map_id, url=url, store=store, recorded=recorded) as source:
        found = write(source, map_id, out, version=version, most_points=points, count=count, force=force)
    if as_json:
        typer.echo(json.dumps({"file": str(out), **asdict(found)}))
        return
    if found.note:
        typer.echo(found.note, err=True)
    if found.unreadable:
        typer.echo(f"{found.unreadable} queries have no points: /log says why", err=True)
    typer.echo(
        f"{out}: {found.points:,} points of version {found.version[:12]}, "
        f"{found.queries:,} recorded queries, {found.localized:,} of them localized"
    )
