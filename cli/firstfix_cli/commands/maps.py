"""``firstfix maps``: list, inspect and switch maps."""

from __future__ import annotations

import json
from dataclasses import asdict
from enum import Enum
from pathlib import Path
from typing import Annotated, Any

import typer

from ..arguments import AsJson, Store, Url, examples
from ..build_report import self_test_lines
from ..version_lines import counted, map_lines, provenance_lines, version_lines

app = typer.Typer(
    help="List, inspect, switch and remove maps.",
    epilog=examples(
        "firstfix maps ls",
        "firstfix maps show hall --url http://localhost:8080",
        "firstfix maps changes hall --picture changes.png",
        "firstfix maps activate hall 3f2a91c0 --store s3://maps/firstfix",
        "firstfix maps rm old-hall --url http://localhost:8080",
        "firstfix maps patch hall --mode propose",
        "firstfix maps verify --store s3://maps/firstfix",
    ),
    no_args_is_help=True,
)

MapArgument = Annotated[str, typer.Argument(metavar="MAP", help="Id of the map.")]
VersionArgument = Annotated[
    str, typer.Argument(metavar="VERSION", help="Version, or its first characters, 4 or more.")
]
ServicesStore = Annotated[
    str, typer.Option(envvar="FIRSTFIX_STORE", metavar="STORE", help="The service's object store.")
]
OtherVersion = Annotated[
    str | None,
    typer.Option(metavar="VERSION", help="Version, or its first characters [default: the active one]."),
]


@app.command("ls")
def list_maps(url: Url = None, store: Store = None, as_json: AsJson = False) -> None:
    """List the maps with their active versions.

    PUBLISHED is in UTC. LOCALIZED is the share of the build's own test scans that were localized.
    """
    from ..map_admin import map_admin

    with map_admin(url, store) as admin:
        maps = admin.maps()
    if as_json:
        typer.echo(json.dumps({"maps": maps}))
        return
    typer.echo("\n".join(map_lines(maps)))


@app.command()
def show(
    map_id: MapArgument,
    version: OtherVersion = None,
    url: Url = None,
    store: Store = None,
    as_json: AsJson = False,
) -> None:
    """Show a map: its active version, origin, sizes and self-test."""
    from ..map_admin import map_admin

    with map_admin(url, store) as admin:
        details = admin.show(map_id, None if version is None else admin.full_version(map_id, version))
    if as_json:
        typer.echo(json.dumps(details))
    else:
        typer.echo("\n".join(_lines(details)))


@app.command()
def versions(map_id: MapArgument, url: Url = None, store: Store = None, as_json: AsJson = False) -> None:
    """List a map's versions, newest first, and their origin.

    The active one is marked by a star. FROM is the threshold: a scan is localized from this probability on.
    """
    from ..map_admin import map_admin

    with map_admin(url, store) as admin:
        found = admin.versions(map_id)
    if as_json:
        typer.echo(json.dumps({"versions": found}))
        return
    typer.echo("\n".join(version_lines(found)))


@app.command()
def changes(
    map_id: MapArgument,
    version: OtherVersion = None,
    picture: Annotated[
        Path | None, typer.Option(metavar="FILE.png", help="Draw the areas from above.")
    ] = None,
    url: Url = None,
    store: Store = None,
    as_json: AsJson = False,
) -> None:
    """List the areas that have changed or were never mapped.

    The localized queries show it. What a replica has counted last is in the store only some minutes later.
    """
    from ..changes import draw_changes, lines_of
    from ..map_admin import map_admin

    with map_admin(url, store) as admin:
        if version is not None:
            version = admin.full_version(map_id, version)
        found = admin.changes(map_id, version, with_cells=picture is not None)
    if picture is not None:
        draw_changes(found, picture)
    typer.echo(json.dumps(found) if as_json else "\n".join(lines_of(found)))


@app.command()
def activate(
    map_id: MapArgument,
    version: VersionArgument,
    url: Url = None,
    store: Store = None,
    as_json: AsJson = False,
) -> None:
    """Make a version the active one, older or newer."""
    from ..map_admin import map_admin

    with map_admin(url, store) as admin:
        chosen = admin.full_version(map_id, version)
        admin.activate(map_id, chosen)
    _print_state(map_id, chosen, "active", as_json)


@app.command()
def rollback(map_id: MapArgument, url: Url = None, store: Store = None, as_json: AsJson = False) -> None:
    """Make the previously active version active again."""
    from ..map_admin import map_admin

    with map_admin(url, store) as admin:
        chosen = admin.roll_back(map_id)
    _print_state(map_id, chosen, "active", as_json)


class Mode(str, Enum):
    """Whether a patched version is activated or waits."""

    propose = "propose"
    activate = "activate"


@app.command()
def patch(
    map_id: MapArgument,
    mode: Annotated[
        Mode | None,
        typer.Option(help="Whether the patched version waits [default: patch of the map's build config]."),
    ] = None,
    url: Url = None,
    store: Store = None,
    as_json: AsJson = False,
) -> None:
    """Lay into a map what several robots have seen for days.

    A service or a worker builds the patched version. rollback takes it back.
    """
    from ..map_admin import map_admin

    with map_admin(url, store) as admin:
        build_id = admin.patch(map_id, None if mode is None else mode.value)
    said = {"map_id": map_id, "build_id": build_id}
    typer.echo(json.dumps(said) if as_json else f"{map_id}: build {build_id} is queued")


@app.command()
def retire(
    map_id: MapArgument,
    version: VersionArgument,
    force: Annotated[bool, typer.Option("--force", help="Also if it is the active version.")] = False,
    url: Url = None,
    store: Store = None,
    as_json: AsJson = False,
) -> None:
    """Take a version out of service.

    After a day, gc removes its files.
    """
    from ..map_admin import map_admin

    with map_admin(url, store) as admin:
        chosen = admin.full_version(map_id, version)
        admin.retire(map_id, chosen, force=force)
    _print_state(map_id, chosen, "retired", as_json)


@app.command("rm")
def remove(
    map_id: MapArgument,
    force: Annotated[bool, typer.Option("--force", help="Do not ask.")] = False,
    url: Url = None,
    store: Store = None,
    as_json: AsJson = False,
) -> None:
    """Remove a map: take all its versions out of service.

    It asks first; without a terminal it needs --force. After a day, gc removes the files. A build of the map
    that still runs publishes it again: cancel it first.
    """
    from ..confirm import confirm
    from ..map_admin import map_admin

    with map_admin(url, store) as admin:
        count = len(admin.versions(map_id))
        confirm(f"remove map {map_id} with {count} versions", force=force)
        retired = admin.remove(map_id)
    said = {"map_id": map_id, "retired": retired}
    typer.echo(json.dumps(said) if as_json else f"{map_id}: removed, with {counted(len(retired), 'version')}")


@app.command()
def rebuild(
    map_ids: Annotated[list[str], typer.Argument(metavar="MAP...", help="Ids of the maps.")],
    store: ServicesStore,
    exact: Annotated[
        bool, typer.Option("--exact", help="Keep no learned keys and no calibration of an earlier version.")
    ] = False,
) -> None:
    """Build maps again from their sources.

    The builds use the files and the config of the active versions. A service or a worker runs them.
    """
    from firstfix.catalog.catalog import Catalog
    from firstfix.maintenance.rebuild import rebuild as request_rebuild

    from ..stores import existing_store

    catalog = Catalog(existing_store(store))
    for map_id in map_ids:
        typer.echo(f"{map_id}: build {request_rebuild(catalog, map_id, exact=exact)} is queued")


@app.command("gc")
def collect_garbage(
    map_id: Annotated[
        str | None, typer.Argument(metavar="[MAP]", help="Id of one map [default: all].")
    ] = None,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Only report what would be removed.")] = False,
    url: Url = None,
    store: Store = None,
    as_json: AsJson = False,
) -> None:
    """Remove unreferenced objects from the store.

    These are retired versions, unused sources, abandoned uploads and old records.
    """
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
    store: ServicesStore,
    repair: Annotated[
        bool,
        typer.Option("--repair", help="Repair what can be repaired, and set unreadable records aside."),
    ] = False,
    cache: Annotated[
        Path | None,
        typer.Option(help="Folder with fetched versions on this machine, as a source for repairs."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Check all objects of a store for damage.

    It reads records, logs, versions, sources, recorded queries and uploads. The exit code is 2 if damage
    remains.
    """
    from firstfix.maintenance.repair import Repair
    from firstfix.maintenance.verify import Verification

    from ..stores import existing_store

    opened = existing_store(store, read_only=not repair)
    report = Verification(opened, repair=Repair(opened, cache) if repair else None).run()
    if as_json:
        typer.echo(json.dumps(asdict(report)))
    else:
        for finding in report.findings:
            typer.echo(f"{finding.key}: {finding.problem}")
            typer.echo(f"    {finding.mended or 'damaged'}")
        for kind, count in sorted(report.kinds.items()):
            typer.echo(f"{kind:16} {count:8,}")
        counted = f"{report.objects:,} objects checked, {report.bytes / 1e6:,.1f} MB read"
        mended = len(report.findings) - len(report.damaged)
        typer.echo(f"{counted}: {mended} mended, {len(report.damaged)} damaged")
    if report.damaged:
        raise typer.Exit(2)


def _print_state(map_id: str, version: str, state: str, as_json: bool) -> None:
    said = {"map_id": map_id, "version": version, "state": state}
    typer.echo(json.dumps(said) if as_json else f"{map_id}: version {version} is {state}")


def _lines(details: dict[str, Any]) -> list[str]:
    """A summary of a map as text; ``--json`` has all details."""
    version = details.get("version") or details["active_version"]
    versions = counted(details["versions"], "version")
    lines = [f"{details['map_id']}: {versions}, active {details['active_version']}"]
    manifest = details.get("manifest")
    if manifest is None:
        return lines
    if version != details["active_version"]:
        lines.append(f"version {version}, which is not active:")
    lines += [f"  {line}" for line in provenance_lines(details)]
    counts = ", ".join(f"{count:,} {name.replace('_', ' ')}" for name, count in manifest["counts"].items())
    megabytes = sum(entry["bytes"] for entry in manifest["files"].values()) / 1e6
    if manifest.get("provisional"):
        lines.append("  provisional: coarse and little tested, until the full version takes its place")
    lines.append(f"  {counts}, {megabytes:,.1f} MB, made for {manifest['sensor'].get('name', '?')}")
    if manifest["bounds"]:
        low, high = manifest["bounds"]
        size = " x ".join(f"{b - a:,.1f}" for a, b in zip(low, high, strict=True))
        lines.append(f"  {size} m")
    return [*lines, *(f"  {line}" for line in self_test_lines(manifest["self_test"]))]
