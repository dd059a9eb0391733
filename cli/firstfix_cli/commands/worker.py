"""``firstfix worker``: runs builds that services hand to NATS."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ..arguments import Store
from .serve import settings_of


def worker(
    store: Store = None,
    nats: Annotated[
        str | None, typer.Option(metavar="URL", help="NATS server with JetStream, such as nats://host:4222.")
    ] = None,
    work: Annotated[Path | None, typer.Option(help="For sources and finished stages.")] = None,
    concurrency: Annotated[int, typer.Option(min=1, max=64, help="Builds at the same time.")] = 1,
    health_port: Annotated[
        int | None, typer.Option(min=1, max=65535, help="Answer /healthz, /readyz and /metrics there.")
    ] = None,
    share_stages: Annotated[
        bool | None,
        typer.Option(
            "--share-stages/--no-share-stages", help="Keep finished stages in the store [default: yes]."
        ),
    ] = None,
) -> None:
    """Build maps that services take and hand to NATS, until it is stopped.

    What is not given comes from the environment: FIRSTFIX_STORE, FIRSTFIX_BUILD_QUEUE and the others.
    """
    from firstfix_service.builds.worker import run_worker

    settings = settings_of(store=store, work=work, build_queue=nats, share_stages=share_stages)
    run_worker(settings, concurrency=concurrency, health_port=health_port)
