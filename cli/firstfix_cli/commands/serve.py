"""``firstfix serve``: run the query service."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from ..arguments import ServiceStore, examples

EXAMPLES = examples(
    "firstfix serve --store store",
    "firstfix serve --store s3://maps/firstfix --host 0.0.0.0 --zenoh-listen tcp/0.0.0.0:7447",
)


def serve(
    store: ServiceStore = None,
    host: Annotated[str | None, typer.Option(help="Address to listen on [default: 127.0.0.1].")] = None,
    port: Annotated[int | None, typer.Option(help="Port; 0: any free one [default: 8080].")] = None,
    zenoh: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Also answer over zenoh, with this configuration file."),
    ] = None,
    zenoh_listen: Annotated[
        list[str] | None,
        typer.Option(
            metavar="ENDPOINT", help="Also answer over zenoh, at this endpoint, such as tcp/0.0.0.0:7447."
        ),
    ] = None,
    work: Annotated[Path | None, typer.Option(help="Folder for uploads and for stages of builds.")] = None,
) -> None:
    """Run the query service.

    It answers queries over HTTP, and over zenoh if configured, and builds maps that are uploaded. Other
    settings come from environment variables: FIRSTFIX_STORE, FIRSTFIX_PORT and so on.
    """
    from firstfix_service.server import serve as run_service

    settings = settings_of(
        store=store, host=host, port=port, zenoh=zenoh, zenoh_listen=zenoh_listen, work=work
    )
    new = new_store(settings.store)
    if new is not None:
        typer.echo(f"firstfix: {new}", err=True)
    started(lambda: run_service(settings))


def started(run: Callable[[], None]) -> None:
    """Run a service, or say why it cannot start."""
    from firstfix_service.startup.free_address import EXIT_NOT_STARTED, StartFailed

    try:
        run()
    except StartFailed as error:
        typer.echo(f"firstfix: {error}", err=True)
        raise typer.Exit(EXIT_NOT_STARTED) from None


def new_store(url: str) -> str | None:
    """A line about a folder without maps that is to be the store; None: it has some, or is remote."""
    from firstfix.store.url import StoreUrl

    parsed = StoreUrl.parse(url)
    if parsed.scheme != "file":
        return None
    folder = Path(parsed.prefix).absolute()
    if not folder.exists():
        return f"the store is empty and new: the folder {folder} is made now. Is the path right?"
    if not (folder / "maps").exists():
        return f"the store is empty: the folder {folder} has no map. Is the path right?"
    return None


def settings_of(
    *,
    store: str | None,
    host: str | None = None,
    port: int | None = None,
    zenoh: Path | None = None,
    zenoh_listen: list[str] | None = None,
    work: Path | None = None,
    build_queue: str | None = None,
    share_stages: bool | None = None,
) -> Any:
    """The service's settings. The command line has precedence over the environment.

    Raises:
        InvalidOption: a setting is missing or out of range.
    """
    from pydantic import ValidationError

    from firstfix.builds.plain_problems import plain_problems
    from firstfix.errors import InvalidOption
    from firstfix_service.settings import SHARED_STAGES_BYTES, Settings

    given: dict[str, Any] = {
        "store": store,
        "host": host,
        "port": port,
        "zenoh_config": zenoh,
        "work_dir": work,
        "build_queue": build_queue,
        "shared_stages_max_bytes": None if share_stages is None else SHARED_STAGES_BYTES * share_stages,
    }
    if zenoh_listen:
        given |= {"zenoh": True, "zenoh_listen": tuple(zenoh_listen)}
    if sys.stderr.isatty():
        given["log_json"] = False
    try:
        return Settings(**{name: value for name, value in given.items() if value is not None})
    except ValidationError as error:
        if any(item["loc"] == ("store",) and item["type"] == "missing" for item in error.errors()):
            raise InvalidOption("give the store of maps: --store DIR, or FIRSTFIX_STORE") from None
        raise InvalidOption(plain_problems(error)) from None
