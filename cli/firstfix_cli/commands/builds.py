"""``firstfix builds``: list, follow and cancel the builds of a service."""

from __future__ import annotations

import json
from collections.abc import Mapping
from enum import Enum
from typing import Annotated, Any

import typer

from ..arguments import AsJson, Store, Url, examples
from ..version_lines import SHORT, minute_of, table

app = typer.Typer(
    help="List, show, follow and cancel builds.",
    epilog=examples(
        "firstfix builds ls --map hall",
        "firstfix builds follow 20260302t090000000000-0000000a",
        "firstfix builds logs 20260302t090000000000-0000000a --store s3://maps/firstfix",
    ),
    no_args_is_help=True,
)

BuildArgument = Annotated[
    str, typer.Argument(metavar="BUILD", help="Id of the build, as build --no-wait and builds ls print it.")
]
SHOWN = 20


class State(str, Enum):
    """State of a build."""

    queued = "queued"
    running = "running"
    succeeded = "succeeded"
    failed = "failed"
    cancelled = "cancelled"


@app.command("ls")
def list_builds(
    map_id: Annotated[
        str | None, typer.Option("--map", metavar="MAP", help="Only builds of this map.")
    ] = None,
    state: Annotated[State | None, typer.Option(help="Only builds in this state.")] = None,
    limit: Annotated[int, typer.Option(metavar="COUNT", min=1, help="Limit on the builds.")] = SHOWN,
    url: Url = None,
    store: Store = None,
    as_json: AsJson = False,
) -> None:
    """List the recorded builds, newest first. BEGUN is in UTC."""
    from ..build_admin import build_admin

    with build_admin(url, store) as admin:
        found = admin.builds(map_id, None if state is None else state.value, limit)
    if as_json:
        typer.echo(json.dumps({"builds": [_said(one) for one in found]}))
        return
    rows = [("BUILD", "MAP", "BEGUN", "STATE", "STAGE", "DONE", "VERSION, OR WHY")]
    for one in found:
        why = (one.version or "")[:SHORT] or one.waits_for or one.error_detail or ""
        rows.append(
            (one.build_id, one.map_id, _begun(one.build_id), one.state, one.stage, f"{one.progress:.0%}", why)
        )
    typer.echo("\n".join(table(rows)))
    if not found:
        typer.echo("no such builds: only services record theirs, `firstfix build --store` does not", err=True)


@app.command()
def show(build_id: BuildArgument, url: Url = None, store: Store = None, as_json: AsJson = False) -> None:
    """Show a build: its state, source, stages, and why it waits.

    It shows the time of each stage that has ended, and of a build that failed why.
    """
    from ..build_admin import build_admin

    with build_admin(url, store) as admin:
        details = admin.details(build_id)
    typer.echo(json.dumps(details) if as_json else "\n".join(_lines(details)))


@app.command()
def follow(build_id: BuildArgument, url: Url = None, store: Store = None, as_json: AsJson = False) -> None:
    """Follow a build until it has ended.

    The exit code is 0 if it has succeeded.
    """
    from firstfix.errors import BuildCancelled, BuildFailed

    from ..build_admin import build_admin
    from ..remote_build import follower
    from ..stage_bars import stage_progress

    status = None
    with build_admin(url, store) as admin, stage_progress() as tell:
        shown = follower(tell)
        for status in admin.follow(build_id):
            shown(status)
            if status.state == "cancelled":
                raise BuildCancelled(f"build {build_id} was cancelled")
            if status.state in ("failed", "unreadable"):
                raise BuildFailed(status.error_detail or f"build {build_id} failed")
    if status is None or not status.is_final:
        raise BuildFailed(f"the record of build {build_id} is gone")
    if as_json:
        typer.echo(json.dumps(_said(status)))
    else:
        typer.echo(f"published {status.map_id}, version {status.version}{_not_active(status.activated)}")


@app.command()
def cancel(build_id: BuildArgument, url: Url = None, store: Store = None) -> None:
    """Cancel a build. A build that waits ends at once, a running one within seconds."""
    from ..build_admin import build_admin

    with build_admin(url, store) as admin:
        admin.cancel(build_id)
    typer.echo(f"build {build_id} is to stop")


@app.command()
def logs(build_id: BuildArgument, url: Url = None, store: Store = None) -> None:
    """Print the end of a build's log, of up to 64 KiB.

    It is kept whenever an attempt at the build has ended. A service shows it to admins alone, because it
    names files of the machine.
    """
    from ..build_admin import build_admin
    from ..log_lines import plain_lines

    with build_admin(url, store) as admin:
        text = admin.log(build_id)
    for line in plain_lines(text):
        typer.echo(line)


def _said(one: Any) -> dict[str, Any]:
    return {
        "build_id": one.build_id,
        "map_id": one.map_id,
        "state": one.state,
        "stage": one.stage,
        "progress": one.progress,
        "version": one.version,
        "activated": one.activated,
        "waits_for": one.waits_for,
        "error": None if one.error_code is None else {"code": one.error_code, "detail": one.error_detail},
    }


def _lines(details: Mapping[str, Any]) -> list[str]:
    state, error = details["state"], details.get("error") or {}
    lines = [f"build {details['build_id']} of {details['map_id']}: {state}"]
    if details.get("file_name"):
        lines.append(f"  made of {details['file_name']}")
    if details.get("caller"):
        lines.append(f"  by {details['caller']}")
    if details.get("note"):
        lines.append(f"  note: {details['note']}")
    if state == "running":
        lines.append(f"  {details['stage']}, {details['progress']:.0%} of the build")
    if details.get("waits_for"):
        lines.append(f"  it waits: {details['waits_for']}")
    if error:
        where = f" in {details['stage']}" if details.get("stage") else ""
        lines.append(f"  {error['code']}{where}: {error['detail']}")
    if details.get("version"):
        lines.append(f"  version {details['version']}{_not_active(details.get('activated', False))}")
    lines += [f"  {one['severity']:<7} {one['text']}" for one in details.get("findings") or ()]
    for stage in details.get("stages") or ():
        reused = ", reused" if stage.get("cached") else ""
        lines.append(f"  {stage['stage']:18} {stage['seconds']:8.1f} s{reused}")
    return lines


def _not_active(activated: bool) -> str:
    return "" if activated else ", NOT ACTIVATED"


def _begun(build_id: str) -> str:
    """The time at which a build was asked for: its id begins with it."""
    digits = build_id[:8] + build_id[9:13]
    if build_id[8:9] != "t" or not digits.isdigit():
        return "-"
    y, m, d, clock = digits[:4], digits[4:6], digits[6:8], f"{digits[8:10]}:{digits[10:12]}"
    return minute_of(f"{y}-{m}-{d}T{clock}")
