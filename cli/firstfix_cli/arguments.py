"""Options that several commands share, and what they stand for."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

if TYPE_CHECKING:
    from firstfix_client import Client

DEFAULT_URL = "http://127.0.0.1:8080"

PATIENCE_S = 5.0  # a person is told soon that nobody is there
Url = Annotated[
    str | None,
    typer.Option(
        help="Address of the service over HTTP, or of several replicas with commas between "
        f"[default: FIRSTFIX_URL of the environment, else {DEFAULT_URL}]."
    ),
]
Zenoh = Annotated[
    str | None, typer.Option(metavar="ENDPOINT", help="zenoh endpoint, such as tcp/localhost:7447.")
]
Store = Annotated[
    str | None,
    typer.Option(help="Object store: a directory, s3://..., gs://..., az://... No service is needed then."),
]
MapId = Annotated[str, typer.Option("--map", help="Id of the map.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON, for programs.")]
SentAs = Annotated[
    Literal["scan", "range_image", "compact", "descriptor"],
    typer.Option(
        "--encoding",
        help="What is sent: the scan; the scan as a range image, under 90 KB of 120,000 points; a compact "
        "query, under 10 KB; or its descriptor, under 1.5 KB, which gives candidates only.",
    ),
]
TimeoutS = Annotated[float, typer.Option("--timeout", help="Seconds that one answer may take.", min=0.1)]


def cache_directory(name: str) -> Path:
    """Where this user's fetched versions and build stages are kept."""
    root = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(root) / "firstfix" / name


def client_of(url: str | None, timeout_s: float = 10.0) -> Client:
    from firstfix_client import Client, RetryPolicy

    asked = url or os.environ.get("FIRSTFIX_URL") or DEFAULT_URL
    return Client(asked, timeout_s=timeout_s, retry=RetryPolicy(patience_s=PATIENCE_S))
