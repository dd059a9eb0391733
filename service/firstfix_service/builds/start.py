"""Start of the build queue of a service, as the settings say."""

from __future__ import annotations

import importlib.util
from contextlib import AsyncExitStack

from firstfix.catalog.catalog import Catalog

from ..maintenance.cleanup import shared_stages_removal
from ..settings import Settings
from ..telemetry.metrics import Metrics
from ..thread_pools.background import run_in_background
from .nats.queue import NatsBuildQueue
from .queue import BuildQueue, EmbeddedBuildQueue


def builder_is_installed() -> bool:
    """Whether this installation can build maps. It finds the mesh tool without importing it."""
    return all(importlib.util.find_spec(name) is not None for name in ("firstfix_builder", "open3d"))


def start_builds(
    settings: Settings, catalog: Catalog, metrics: Metrics, stack: AsyncExitStack
) -> BuildQueue | None:
    """Start the build queue, which runs until the stack is closed.

    Returns None if this process only records builds and another one runs them.
    """
    if settings.read_only:
        return None
    if settings.nats_enabled:
        queue: BuildQueue = NatsBuildQueue(settings, catalog, metrics)
        run_in_background(stack, queue.run(), "build-queue")
        return queue
    wanted = builder_is_installed() if settings.run_builds is None else settings.run_builds
    if not wanted:
        return None
    queue = EmbeddedBuildQueue(settings, catalog, metrics)
    run_in_background(stack, queue.run(), "build-queue")
    if settings.shared_stages_bytes:
        shared_stages_removal(settings, catalog.store).start(stack)
    return queue
