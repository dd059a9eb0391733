"""``firstfix keys``: manage API keys."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Callable
from datetime import datetime, timedelta, timezone
from typing import TYPE_CHECKING, Annotated

import typer

from firstfix.errors import InvalidOption

from ..arguments import AsJson, examples

if TYPE_CHECKING:
    from firstfix.access.api_keys import ApiKey, ApiKeys

app = typer.Typer(
    help="Create, list and revoke API keys.",
    epilog=examples(
        "firstfix keys create --store s3://maps/firstfix --name robot-7 --scope localize --expires 90d",
        "firstfix keys ls --store s3://maps/firstfix",
    ),
    no_args_is_help=True,
)

Store = Annotated[
    str,
    typer.Option(
        envvar="FIRSTFIX_STORE",
        metavar="STORE",
        help="Object store of the service: a directory, s3://..., gs://... or az://...",
    ),
]
_DURATION = re.compile(r"(\d{1,5})([hd])")


@app.command()
def create(
    store: Store,
    name: Annotated[str, typer.Option(help="Name of its owner.")],
    scope: Annotated[
        list[str],
        typer.Option(help="localize, build (includes localize), metrics or admin; can be repeated."),
    ],
    map_pattern: Annotated[
        list[str] | None,
        typer.Option(
            "--map", metavar="PATTERN", help="Maps that it may use, such as 'hall-*' [default: all]."
        ),
    ] = None,
    expires: Annotated[
        str | None,
        typer.Option(help="Lifetime (90d, 12h) or date of expiry (2030-01-31) [default: never]."),
    ] = None,
    token_env: Annotated[
        str | None,
        typer.Option(
            metavar="VARIABLE",
            help="Take the key from this environment variable. If the key exists, nothing changes.",
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Create a key and print it. It cannot be shown again."""
    from firstfix.access.api_keys import ApiKeys
    from firstfix.access.permissions import ALL_MAPS, Grant
    from firstfix.store.store import Store as ObjectStore

    grant = Grant.parse(scope, map_pattern or ALL_MAPS)
    given = None if token_env is None else os.environ.get(token_env, "")
    opened = ObjectStore.open(store)
    until = None if expires is None else _time(expires, opened.now)
    key, token = ApiKeys(opened).create(name, grant, until, given)
    if given is not None and not as_json:  # the caller has it: do not print it into a log
        typer.echo(_line(key))
        return
    if as_json:
        typer.echo(json.dumps({**key.to_mapping(), "key": token}))
        return
    typer.echo(token)
    typer.echo(
        f"{_line(key)}\nKeep the key: the store has only its hash. Services take it at once, or within 5 s.",
        err=True,
    )


@app.command("ls")
def list_keys(store: Store, as_json: AsJson = False) -> None:
    """List the keys, oldest first. The keys themselves are not stored."""
    found, bad = _keys(store).all()
    if as_json:
        typer.echo(json.dumps({"keys": [key.to_mapping() for key in found], "unreadable": bad}))
        return
    for key in found:
        typer.echo(_line(key))
    for key_id in bad:
        typer.echo(f"{key_id}  cannot be read, so it is not accepted")


@app.command()
def revoke(
    key_id: Annotated[str, typer.Argument(metavar="KEY_ID", help="Id of the key, see 'firstfix keys ls'.")],
    store: Store,
) -> None:
    """Revoke a key for good. Services follow within 5 s."""
    _keys(store).revoke(key_id)
    typer.echo(f"key {key_id} is revoked")


def _keys(store: str) -> ApiKeys:
    from firstfix.access.api_keys import ApiKeys

    from ..stores import existing_store

    return ApiKeys(existing_store(store))


def _line(key: ApiKey) -> str:
    scopes = ",".join(sorted(scope.value for scope in key.grant.scopes))
    if key.revoked:
        state = "revoked"
    elif key.is_expired(datetime.now(timezone.utc)):
        state = "expired"
    else:
        state = "never expires" if key.expires_time is None else f"until {key.expires_time}"
    return f"{key.key_id}  {key.name}  {scopes} on {','.join(key.grant.maps)}  {state}"


def _time(text: str, store_now: Callable[[], datetime]) -> datetime:
    """The time of expiry; a duration begins now by the store's clock.

    Raises:
        InvalidOption: the text is neither a duration nor a date.
    """
    if (match := _DURATION.fullmatch(text)) is not None:
        count = int(match[1])
        span = timedelta(hours=count) if match[2] == "h" else timedelta(days=count)
        return store_now() + span
    try:
        time = datetime.fromisoformat(text)
    except ValueError:
        raise InvalidOption(
            f"--expires must be a duration (90d, 12h) or a date (2030-01-31), not {text[:40]!r}"
        ) from None
    return time if time.tzinfo is not None else time.replace(tzinfo=timezone.utc)
