"""``firstfix worker``: run a build worker."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ..arguments import ServiceStore, examples
from .serve import settings_of, started

EXAMPLES = examples(
    "firstfix worker --store s3://maps/firstfix --nats nats://queue:4222",
)


def worker(
    store: ServiceStore = None,
    nats: Annotated[
        str | None, typer.Option(metavar="URL", help="NATS server with JetStream, such as nats://host:4222.")
    ] = None,
    work: Annotated[Path | None, typer.Option(help="Folder for sources and finished stages.")] = None,
    concurrency: Annotated[
        int, typer.Option(min=1, max=64, help="Number of builds that run at the same time.")
    ] = 1,
    health_port: Annotated[
        int | None, typer.Option(min=1, max=65535, help="Port for /healthz, /readyz and /metrics.")
    ] = None,
    share_stages: Annotated[
        bool | None,
        typer.Option(
            "--share-stages/--no-share-stages", help="Keep finished stages in the store [default: yes]."
        ),
    ] = None,
) -> None:
    """Run a build worker.

    It takes builds from the NATS queue of the services, until it is stopped. Other settings come from
    environment variables: FIRSTFIX_STORE, FIRSTFIX_BUILD_QUEUE and so on.
    """
    from firstfix_service.builds.worker import run_worker
    from firstfix_service.startup.free_address import check_port

    settings = settings_of(store=store, work=work, build_queue=nats, share_stages=share_stages)

    def run() -> None:
        if health_port is not None:
            check_port(settings.host, health_port, "--health-port")
        run_worker(settings, concurrency=concurrency, health_port=health_port)

    started(run)
