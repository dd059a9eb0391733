"""``firstfix samples``: look at queries that a service has kept."""

from __future__ import annotations

import json
import math
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ..arguments import AsJson, Url, examples

if TYPE_CHECKING:
    from firstfix.catalog.recorded_queries import QuerySample, QuerySamples

app = typer.Typer(
    help="List, show, fetch, confirm and remove kept queries. FIRSTFIX_SAMPLES_SHARE keeps some.",
    epilog=examples(
        "firstfix samples ls --url http://localhost:8080 --map hall",
        "firstfix samples confirm 20260302t090000000000-0000000a --url http://localhost:8080",
        "firstfix samples fetch --store s3://maps/firstfix -o samples",
    ),
    no_args_is_help=True,
)

SamplesStore = Annotated[
    str, typer.Option("--store", help="Store that holds them: the service's object store, or a directory.")
]
SampleArgument = Annotated[str, typer.Argument(metavar="SAMPLE", help="Id of the kept query.")]


@app.command("ls")
def list_samples(
    store: Annotated[
        str | None,
        typer.Option("--store", help="Read them from the object store, without a service."),
    ] = None,
    url: Url = None,
    map_id: Annotated[str | None, typer.Option("--map", help="Only queries about this map.")] = None,
    as_json: AsJson = False,
) -> None:
    """List the kept queries, oldest first.

    Those of the service at --url, or with --store those of its object store.
    """
    from firstfix.errors import InvalidOption

    if store is not None and url is not None:
        raise InvalidOption("give only one of --url and --store")
    if store is None:
        from ..viewer_client import ViewerClient

        client = ViewerClient.at(url)
        with client:
            found = list(client.samples(map_id))[::-1]
    else:
        found = [one for one in _samples(store).each() if map_id is None or one.is_about(map_id)]
    if as_json:
        typer.echo(json.dumps({"samples": [asdict(sample) for sample in found]}))
        return
    for sample in found:
        typer.echo(_line(sample))


@app.command()
def show(sample_id: SampleArgument, store: SamplesStore) -> None:
    """Show a query and its answer, as JSON."""
    typer.echo(json.dumps(asdict(_samples(store).get(sample_id)), indent=1))


@app.command()
def fetch(
    store: SamplesStore,
    sample_id: Annotated[
        str | None, typer.Argument(metavar="SAMPLE", help="Id of one kept query [default: all].")
    ] = None,
    out: Annotated[Path, typer.Option("-o", "--out", help="Folder to write to.")] = Path(),
) -> None:
    """Write kept queries as files.

    Each becomes SAMPLE.json and its scan, which 'firstfix localize' can read.
    """
    kept = _samples(store)
    out.mkdir(parents=True, exist_ok=True)
    for sample in kept.each() if sample_id is None else [kept.get(sample_id)]:
        body = _plain_body(kept, sample)
        path = out / f"{sample.sample_id}{_suffix(sample.media_type)}"
        path.write_bytes(body)
        (out / f"{sample.sample_id}.json").write_text(json.dumps(asdict(sample), indent=1) + "\n")
        typer.echo(path)


@app.command()
def confirm(
    sample_ids: Annotated[list[str], typer.Argument(metavar="SAMPLE...", help="Ids of kept queries.")],
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

    if pose is not None and (undo or len(sample_ids) > 1):
        raise InvalidOption("--pose is of one kept query, and not for --undo")
    told = None if pose is None else _pose(pose)
    client = ViewerClient.at(url)
    with client:
        for sample_id in sample_ids:
            client.set_truth(sample_id, {} if undo else _truth_of(client.sample(sample_id), told))
            typer.echo(f"{sample_id}  {'forgotten' if undo else 'confirmed'}")


@app.command("rm")
def remove(
    store: SamplesStore,
    sample_ids: Annotated[
        list[str] | None, typer.Argument(metavar="SAMPLE...", help="Ids of kept queries.")
    ] = None,
    everything: Annotated[bool, typer.Option("--all", help="Remove all kept queries.")] = False,
) -> None:
    """Remove kept queries for good."""
    from firstfix.errors import InvalidOption

    if everything == bool(sample_ids):
        raise InvalidOption("give ids of kept queries, or --all")
    kept = _samples(store)
    doomed = kept.ids() if everything else [kept.get(one).sample_id for one in sample_ids or ()]
    for one in doomed:
        kept.delete(one)
    typer.echo(f"{len(doomed)} removed")


def _truth_of(sample: QuerySample, pose: dict[str, Any] | None) -> dict[str, Any]:
    """The truth of a query: the pose in its map, by default that of its answer."""
    from firstfix.errors import InvalidOption

    map_id = sample.answer.get("map_id") or sample.map_id
    at = pose or sample.answer.get("T_map_sensor")
    if at is None:
        raise InvalidOption(f"{sample.sample_id} was answered without a pose: give --pose")
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


def _samples(store: str) -> QuerySamples:
    from firstfix.catalog.recorded_queries import QuerySamples
    from firstfix.store.store import Store

    return QuerySamples(Store.open(store))


def _plain_body(kept: QuerySamples, sample: QuerySample) -> bytes:
    from firstfix.wire.content_encoding import undo_content_encoding

    from ..viewer_client import MAX_DECODED_BYTES

    body = kept.body(sample.sample_id)
    return bytes(undo_content_encoding(body, sample.content_encoding, MAX_DECODED_BYTES))


def _suffix(media_type: str) -> str:
    """The file suffix for such a body, ``.body`` for an unknown one."""
    from firstfix.decode import SUFFIXES

    name = media_type.split(";", 1)[0].strip().lower()
    return next((suffix for suffix, known in SUFFIXES.items() if known == name), ".body")


def _line(sample: QuerySample) -> str:
    answer = sample.answer
    why = ",".join(answer["reasons"])
    return (
        f"{sample.sample_id}  {sample.map_id or '(any map)':20}  {answer['verdict']:9} "
        f"{answer['probability']:.3f}  {sample.body_bytes / 1e3:9.1f} kB  {why}"
    ).rstrip()
