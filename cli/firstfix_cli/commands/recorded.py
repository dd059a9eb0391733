"""``firstfix recorded``: look at queries that a service has recorded."""

from __future__ import annotations

import json
import math
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ..arguments import AsJson, Url, examples

if TYPE_CHECKING:
    from firstfix.catalog.recorded_queries import RecordedQueries, RecordedQuery

app = typer.Typer(
    help="List, show, fetch, confirm and remove recorded queries. FIRSTFIX_RECORDED_SHARE records some.",
    epilog=examples(
        "firstfix recorded ls --url http://localhost:8080 --map hall",
        "firstfix recorded confirm 20260302t090000000000-0000000a --url http://localhost:8080",
        "firstfix recorded fetch --store s3://maps/firstfix -o recorded",
    ),
    no_args_is_help=True,
)

RecordedStore = Annotated[
    str, typer.Option("--store", help="Store that holds them: the service's object store, or a directory.")
]
QueryArgument = Annotated[str, typer.Argument(metavar="QUERY", help="Id of the recorded query.")]


@app.command("ls")
def list_recorded(
    store: Annotated[
        str | None,
        typer.Option("--store", help="Read them from the object store, without a service."),
    ] = None,
    url: Url = None,
    map_id: Annotated[str | None, typer.Option("--map", help="Only queries about this map.")] = None,
    as_json: AsJson = False,
) -> None:
    """List the recorded queries, oldest first.

    Those of the service at --url, or with --store those of its object store.
    """
    from firstfix.errors import InvalidOption

    if store is not None and url is not None:
        raise InvalidOption("give only one of --url and --store")
    if store is None:
        from ..viewer_client import ViewerClient

        client = ViewerClient.at(url)
        with client:
            found = list(client.recorded_queries(map_id))[::-1]
    else:
        found = [one for one in _recorded_queries(store).each() if map_id is None or one.is_about(map_id)]
    if as_json:
        typer.echo(json.dumps({"queries": [asdict(recorded) for recorded in found]}))
        return
    for recorded in found:
        typer.echo(_line(recorded))


@app.command()
def show(query_id: QueryArgument, store: RecordedStore) -> None:
    """Show a query and its answer, as JSON."""
    typer.echo(json.dumps(asdict(_recorded_queries(store).get(query_id)), indent=1))


@app.command()
def fetch(
    store: RecordedStore,
    query_id: Annotated[
        str | None, typer.Argument(metavar="QUERY", help="Id of one recorded query [default: all].")
    ] = None,
    out: Annotated[Path, typer.Option("-o", "--out", help="Folder to write to.")] = Path(),
) -> None:
    """Write recorded queries as files.

    Each becomes QUERY.json and its scan, which 'firstfix localize' can read.
    """
    stored = _recorded_queries(store)
    out.mkdir(parents=True, exist_ok=True)
    for recorded in stored.each() if query_id is None else [stored.get(query_id)]:
        body = _plain_body(stored, recorded)
        path = out / f"{recorded.query_id}{_suffix(recorded.media_type)}"
        path.write_bytes(body)
        (out / f"{recorded.query_id}.json").write_text(json.dumps(asdict(recorded), indent=1) + "\n")
        typer.echo(path)


@app.command()
def confirm(
    query_ids: Annotated[list[str], typer.Argument(metavar="QUERY...", help="Ids of recorded queries.")],
    url: Url = None,
    pose: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y,Z,QX,QY,QZ,QW",
            help="T_map_sensor where the scan was taken [default: that of the answer].",
        ),
    ] = None,
    undo: Annotated[bool, typer.Option("--undo", help="Forget what was said.")] = False,
) -> None:
    """Say that the answers were right, or where a scan was taken.

    The self-test of the map's next build asks these scans, too.
    """
    from firstfix.errors import InvalidOption

    from ..viewer_client import ViewerClient

    if pose is not None and (undo or len(query_ids) > 1):
        raise InvalidOption("--pose is of one recorded query, and not for --undo")
    told = None if pose is None else _pose(pose)
    client = ViewerClient.at(url)
    with client:
        for query_id in query_ids:
            client.set_truth(query_id, {} if undo else _truth_of(client.recorded_query(query_id), told))
            typer.echo(f"{query_id}  {'forgotten' if undo else 'confirmed'}")


@app.command("rm")
def remove(
    store: RecordedStore,
    query_ids: Annotated[
        list[str] | None, typer.Argument(metavar="QUERY...", help="Ids of recorded queries.")
    ] = None,
    everything: Annotated[bool, typer.Option("--all", help="Remove all recorded queries.")] = False,
) -> None:
    """Remove recorded queries for good."""
    from firstfix.errors import InvalidOption

    if everything == bool(query_ids):
        raise InvalidOption("give ids of recorded queries, or --all")
    stored = _recorded_queries(store)
    doomed = stored.ids() if everything else [stored.get(one).query_id for one in query_ids or ()]
    for one in doomed:
        stored.delete(one)
    typer.echo(f"{len(doomed)} removed")


def _truth_of(recorded: RecordedQuery, pose: dict[str, Any] | None) -> dict[str, Any]:
    """The truth of a query: the pose in its map, by default that of its answer."""
    from firstfix.errors import InvalidOption

    map_id = recorded.answer.get("map_id") or recorded.map_id
    at = pose or recorded.answer.get("T_map_sensor")
    if at is None:
        raise InvalidOption(f"{recorded.query_id} was answered without a pose: give --pose")
    return {"map_id": map_id, "T_map_sensor": at}


def _pose(text: str) -> dict[str, Any]:
    from firstfix.errors import InvalidOption

    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != 7 or not all(map(math.isfinite, numbers)):
        raise InvalidOption(f"--pose is seven numbers X,Y,Z,QX,QY,QZ,QW, not {text[:80]!r}")
    return {"position": numbers[:3], "quaternion": numbers[3:]}


def _recorded_queries(store: str) -> RecordedQueries:
    from firstfix.catalog.recorded_queries import RecordedQueries

    from ..stores import existing_store

    return RecordedQueries(existing_store(store))


def _plain_body(stored: RecordedQueries, recorded: RecordedQuery) -> bytes:
    from firstfix.catalog.recorded_queries import MAX_DECODED_BYTES
    from firstfix.wire.content_encoding import undo_content_encoding

    body = stored.body(recorded.query_id)
    return bytes(undo_content_encoding(body, recorded.content_encoding, MAX_DECODED_BYTES))


def _suffix(media_type: str) -> str:
    """The file suffix for such a body, ``.body`` for an unknown one."""
    from firstfix.scan_formats import SUFFIXES

    name = media_type.split(";", 1)[0].strip().lower()
    return next((suffix for suffix, known in SUFFIXES.items() if known == name), ".body")


def _line(recorded: RecordedQuery) -> str:
    answer = recorded.answer
    why = ",".join(answer["reasons"])
    return (
        f"{recorded.query_id}  {recorded.map_id or '(any map)':20}  {answer['verdict']:9} "
        f"{answer['probability']:.3f}  {recorded.body_bytes / 1e3:9.1f} kB  {why}"
    ).rstrip()
