"""``firstfix maps``: what there is, and which version answers."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer

from ..arguments import AsJson, Store, Url
from ..self_test_lines import self_test_lines

app = typer.Typer(help="List, inspect and switch maps, of a service or of a store.", no_args_is_help=True)

MapArgument = Annotated[str, typer.Argument(metavar="MAP", help="Id of the map.")]
VersionArgument = Annotated[str, typer.Argument(help="Version, or at least its first 8 characters.")]


@app.command("ls")
def list_maps(url: Url = None, store: Store = None, as_json: AsJson = False) -> None:
    """List the maps and their active versions."""
    from ..map_admin import map_admin

    with map_admin(url, store) as admin:
        maps = admin.maps()
    if as_json:
        typer.echo(json.dumps({"maps": maps}))
        return
    for entry in maps:
        typer.echo(f"{entry['map_id']:24} {entry['active_version'] or 'no active version'}")


@app.command()
def show(map_id: MapArgument, url: Url = None, store: Store = None, as_json: AsJson = False) -> None:
    """Show a map: its active version, sizes and self-test."""
    from ..map_admin import map_admin

    with map_admin(url, store) as admin:
        details = admin.show(map_id)
    if as_json:
        typer.echo(json.dumps(details))
    else:
        typer.echo("\n".join(_lines(details)))


@app.command()
def versions(map_id: MapArgument, url: Url = None, store: Store = None, as_json: AsJson = False) -> None:
    """List a map's versions, newest first; the active one is marked."""
    from ..map_admin import map_admin

    with map_admin(url, store) as admin:
        found = admin.versions(map_id)
    if as_json:
        typer.echo(json.dumps({"versions": found}))
        return
    for entry in found:
        mark = "*" if entry["active"] else " "
        typer.echo(f"{mark} {entry['version']}  {entry['published_time']}")


@app.command()
def activate(
    map_id: MapArgument,
    version: VersionArgument,
    url: Url = None,
    store: Store = None,
    as_json: AsJson = False,
) -> None:
    """Let another version answer from now on: back or forward."""
    from ..map_admin import map_admin
    from ..versions import full_version

    with map_admin(url, store) as admin:
        chosen = full_version(version, (entry["version"] for entry in admin.versions(map_id)))
        admin.activate(map_id, chosen)
    _print_state(map_id, chosen, "active", as_json)


@app.command()
def rollback(map_id: MapArgument, url: Url = None, store: Store = None, as_json: AsJson = False) -> None:
    """Let the version answer that was active before; twice comes back."""
    from ..map_admin import map_admin

    with map_admin(url, store) as admin:
        chosen = admin.roll_back(map_id)
    _print_state(map_id, chosen, "active", as_json)


@app.command()
def retire(
    map_id: MapArgument,
    version: VersionArgument,
    force: Annotated[bool, typer.Option("--force", help="Also if it is the active one.")] = False,
    url: Url = None,
    store: Store = None,
    as_json: AsJson = False,
) -> None:
    """Take a version out of service; gc removes its files a day later."""
    from ..map_admin import map_admin
    from ..versions import full_version

    with map_admin(url, store) as admin:
        chosen = full_version(version, (entry["version"] for entry in admin.versions(map_id)))
        admin.retire(map_id, chosen, force=force)
    _print_state(map_id, chosen, "retired", as_json)


@app.command()
def rebuild(
    map_ids: Annotated[list[str], typer.Argument(metavar="MAP...", help="Ids of the maps.")],
    store: Annotated[str, typer.Option(envvar="FIRSTFIX_STORE", help="The service's object store.")],
) -> None:
    """Build maps again from the files and the config that their active versions were made of."""
    from firstfix.catalog.catalog import Catalog
    from firstfix.store.store import Store as ObjectStore
    from firstfix.upkeep.rebuild import rebuild as put_on_record

    catalog = Catalog(ObjectStore.open(store))
    for map_id in map_ids:
        typer.echo(f"{map_id}: build {put_on_record(catalog, map_id)} is on record")


@app.command("gc")
def collect_garbage(
    map_id: Annotated[str | None, typer.Argument(metavar="[MAP]", help="One map; default: all.")] = None,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Only say what would be removed.")] = False,
    url: Url = None,
    store: Store = None,
    as_json: AsJson = False,
) -> None:
    """Remove what nothing references: retired versions, unused sources, abandoned uploads, old records."""
    from ..map_admin import map_admin

    with map_admin(url, store) as admin:
        found = admin.collect_garbage(map_id, dry_run=dry_run)
    if as_json:
        typer.echo(json.dumps({"dry_run": dry_run, **found}))
        return
    for kind, count in found["objects"].items():
        typer.echo(f"{kind:12} {count:8,} {'objects to remove' if dry_run else 'objects removed'}")


@app.command()
def verify(
    store: Annotated[str, typer.Option(envvar="FIRSTFIX_STORE", help="The service's object store.")],
    repair: Annotated[
        bool,
        typer.Option("--repair", help="Mend what can be mended, and move aside records that cannot be read."),
    ] = False,
    cache: Annotated[
        Path | None, typer.Option(help="Folder of fetched versions on this machine, to mend from.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Read everything in a store, and say what is damaged: records, logs, versions, sources.

    The exit code is 2 where something is damaged and was not mended.
    """
    from firstfix.store.store import Store as ObjectStore
    from firstfix.upkeep.repair import Repair
    from firstfix.upkeep.verify import Verification

    opened = ObjectStore.open(store, read_only=not repair)
    report = Verification(opened, repair=Repair(opened, cache) if repair else None).run()
    if as_json:
        typer.echo(json.dumps(asdict(report)))
    else:
        for finding in report.findings:
            typer.echo(f"{finding.key}: {finding.problem}")
            typer.echo(f"    {finding.mended or 'damaged'}")
        counted = f"{report.objects:,} objects checked, {report.bytes / 1e6:,.1f} MB read"
        mended = len(report.findings) - len(report.damaged)
        typer.echo(f"{counted}: {mended} mended, {len(report.damaged)} damaged")
    if report.damaged:
        raise typer.Exit(2)


def _print_state(map_id: str, version: str, state: str, as_json: bool) -> None:
    said = {"map_id": map_id, "version": version, "state": state}
    typer.echo(json.dumps(said) if as_json else f"{map_id}: version {version} is {state}")


def _lines(details: dict[str, Any]) -> list[str]:
    """What a person asks of a map; ``--json`` has the rest."""
    lines = [f"{details['map_id']}: {details['versions']} versions, active {details['active_version']}"]
    manifest = details.get("manifest")
    if manifest is None:
        return lines
    counts = ", ".join(f"{count:,} {name.replace('_', ' ')}" for name, count in manifest["counts"].items())
    megabytes = sum(entry["bytes"] for entry in manifest["files"].values()) / 1e6
    lines.append(f"  {counts}, {megabytes:,.1f} MB, made for a {manifest['sensor'].get('name', '?')}")
    if manifest["bounds"]:
        low, high = manifest["bounds"]
        size = " x ".join(f"{b - a:,.1f}" for a, b in zip(low, high, strict=True))
        lines.append(f"  {size} m")
    return [*lines, *(f"  {line}" for line in self_test_lines(manifest["self_test"]))]
