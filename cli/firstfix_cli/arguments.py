"""Options that several commands share."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

if TYPE_CHECKING:
    from firstfix_client import Client

DEFAULT_URL = "http://127.0.0.1:8080"

PATIENCE_S = 5.0  # a person wants to know soon that there is no service
Url = Annotated[
    str | None,
    typer.Option(
        help="URL of the service, or of several replicas, separated by commas "
        f"[default: the environment variable FIRSTFIX_URL, else {DEFAULT_URL}]."
    ),
]
Zenoh = Annotated[
    str | None, typer.Option(metavar="ENDPOINT", help="Use zenoh: endpoint such as tcp/localhost:7447.")
]
Store = Annotated[
    str | None,
    typer.Option(help="Use this object store without a service: a directory, s3://..., gs://... or az://..."),
]
ServiceStore = Annotated[
    str | None,
    typer.Option(
        help="Object store of the service: a directory, s3://..., gs://... or az://... "
        "[default: the environment variable FIRSTFIX_STORE]."
    ),
]
MapId = Annotated[str, typer.Option("--map", help="Id of the map.")]
Columns = Annotated[
    str | None,
    typer.Option(
        metavar="NAMES",
        help="Columns of a .bin's float32 rows: x,y,z,intensity,ring,time; _ for one to leave out "
        "[default: told by the numbers].",
    ),
]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON, for programs.")]
SentAs = Annotated[
    Literal["scan", "range_image", "compact", "descriptor"],
    typer.Option(
        "--encoding",
        help="Form in which the scan is sent. scan: all points; range_image: all points, under 90 KB for "
        "120,000; compact: under 10 KB, as accurate; descriptor: under 1.5 KB, gives candidates only.",
    ),
]
TimeoutS = Annotated[float, typer.Option("--timeout", help="Time limit for one answer, in seconds.", min=0.1)]


def cache_directory(name: str) -> Path:
    """The user's folder for cached versions or build stages."""
    root = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(root) / "firstfix" / name


def examples(*commands: str) -> str:
    """Example commands as the end of a help text."""
    return "\n".join(["\b", "Examples:", *(f"  {command}" for command in commands)])


def columns_of(text: str | None) -> tuple[str, ...] | None:
    """The names of ``--columns``.

    Raises:
        InvalidOption: they are none.
    """
    from firstfix.formats.raw_xyz import parse_columns

    return None if text is None else parse_columns(text)


def client_of(url: str | None, timeout_s: float = 10.0) -> Client:
    """A client of the service at ``url``, or at the default one."""
    from firstfix_client import Client, RetryPolicy

    return Client(service_url(url), timeout_s=timeout_s, retry=RetryPolicy(patience_s=PATIENCE_S))


def service_url(url: str | None) -> str:
    """``url``, or the default one."""
    return url or os.environ.get("FIRSTFIX_URL") or DEFAULT_URL
