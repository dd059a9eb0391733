"""Starts what sees to the builds in a service, as its settings say."""

from __future__ import annotations

import asyncio
import importlib.util
from collections.abc import Coroutine
from contextlib import AsyncExitStack, suppress
from typing import Any

from firstfix.catalog.catalog import Catalog

from ..settings import Settings
from ..telemetry.metrics import Metrics
from ..upkeep.stage_keeper import keep_stages_within
from .embedded_queue import EmbeddedBuildQueue
from .nats.queue import NatsBuildQueue
from .process import BuildCommand
from .queue import BuildQueue
from .watch import BuildLimits


def builder_is_installed() -> bool:
    """Whether this installation can build maps. Finds the mesh tool without importing it."""
    return all(importlib.util.find_spec(name) is not None for name in ("firstfix_builder", "open3d"))


def start_builds(
    settings: Settings, catalog: Catalog, metrics: Metrics, stack: AsyncExitStack
) -> BuildQueue | None:
    """The queue, running until the stack is closed; None when another process runs the builds that this
    one records."""
    if settings.read_only:
        return None
    if settings.nats_enabled:
        queue: BuildQueue = NatsBuildQueue(settings, catalog, metrics)
        run_with(stack, queue.run(), "build-queue")
        return queue
    wanted = builder_is_installed() if settings.run_builds is None else settings.run_builds
    if not wanted:
        return None
    queue = EmbeddedBuildQueue(
        catalog,
        metrics,
        command=build_command(settings),
        work_dir=settings.work_dir,
        lease_s=settings.build_lease_s,
        max_attempts=settings.build_attempts,
        limits=build_limits(settings),
    )
    run_with(stack, queue.run(), "build-queue")
    if settings.stages_are_shared:
        run_with(stack, keep_stages_within(settings, catalog.store), "stage-keeper")
    return queue


def build_command(settings: Settings) -> BuildCommand:
    return BuildCommand(
        (*settings.build_command, *_source_url_options(settings), *_executor_options(settings)),
        settings.store,
        settings.build_niceness,
        settings.stages_are_shared,
        settings.build_max_memory_bytes,
        _environment(settings),
    )


def _environment(settings: Settings) -> dict[str, str]:
    """Environment of the worker: variables with the names of the settings."""
    told = {
        "FIRSTFIX_LOG_LEVEL": settings.log_level,
        "FIRSTFIX_LOG_JSON": str(settings.log_json).lower(),
        "FIRSTFIX_BUILD_SANDBOX": settings.build_sandbox,
    }
    if settings.build_max_memory_bytes is not None:
        told["FIRSTFIX_BUILD_MAX_MEMORY_BYTES"] = str(settings.build_max_memory_bytes)
    return told


def build_limits(settings: Settings) -> BuildLimits:
    return BuildLimits(settings.build_timeout_s, settings.build_stall_s)


def _source_url_options(settings: Settings) -> list[str]:
    """The worker asks for itself which servers it may fetch from: what is on record does not say."""
    allowed = [url for url in settings.source_urls if url.startswith(("http://", "https://"))]
    return [option for url in allowed for option in ("--source-url", url)]


def _executor_options(settings: Settings) -> list[str]:
    return [] if settings.build_executor == "threads" else ["--executor", settings.build_executor]


def run_with(stack: AsyncExitStack, work: Coroutine[Any, Any, None], name: str) -> None:
    """Runs it until the stack is closed, which waits for it to wind up."""
    task = asyncio.create_task(work, name=name)

    async def stop() -> None:
        task.cancel()
        with suppress(asyncio.CancelledError):
            await task

    stack.push_async_callback(stop)
