"""Start of the build queue of a service, and the build command, as the settings say."""

from __future__ import annotations

import importlib.util
from contextlib import AsyncExitStack

from firstfix.catalog.catalog import Catalog

from ..maintenance.cleanup import shared_stages_removal
from ..settings import Settings
from ..telemetry.metrics import Metrics
from ..thread_pools.background import run_in_background
from .embedded_queue import EmbeddedBuildQueue
from .nats.queue import NatsBuildQueue
from .process import BuildCommand
from .queue import BuildQueue
from .watch import BuildLimits

MAX_ATTEMPTS = 3  # of a build that dies in the same stage each time: its machine may be at fault once
NICENESS = 10  # of build processes: queries come first


def builder_is_installed() -> bool:
    """Returns whether this installation can build maps. It finds the mesh tool without importing it."""
    return all(importlib.util.find_spec(name) is not None for name in ("firstfix_builder", "open3d"))


def start_builds(
    settings: Settings, catalog: Catalog, metrics: Metrics, stack: AsyncExitStack
) -> BuildQueue | None:
    """Starts the build queue, which runs until the stack is closed.

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
    queue = EmbeddedBuildQueue(
        catalog,
        metrics,
        command=build_command(settings),
        work_dir=settings.work_dir,
        lease_s=settings.build_lease_s,
        max_attempts=MAX_ATTEMPTS,
        limits=build_limits(settings),
    )
    run_in_background(stack, queue.run(), "build-queue")
    if settings.shared_stages_bytes:
        shared_stages_removal(settings, catalog.store).start(stack)
    return queue


def build_command(settings: Settings) -> BuildCommand:
    """Returns the build command and its limits."""
    return BuildCommand(
        (
            *settings.build_command,
            *_source_url_options(settings),
            *_executor_options(settings),
        ),
        settings.store,
        NICENESS,
        settings.shared_stages_bytes > 0,
        settings.build_max_memory_bytes or None,
        _environment(settings),
    )


def _environment(settings: Settings) -> dict[str, str]:
    """Variables of the build process, named like the settings."""
    return {
        "FIRSTFIX_LOG_LEVEL": settings.log_level,
        "FIRSTFIX_LOG_JSON": str(settings.log_json).lower(),
        "FIRSTFIX_BUILD_SANDBOX": settings.build_sandbox,
        "FIRSTFIX_BUILD_MAX_MEMORY_BYTES": str(settings.build_max_memory_bytes),
        "FIRSTFIX_BUILD_MAX_TEMPLATES": str(settings.build_max_templates),
    }


def build_limits(settings: Settings) -> BuildLimits:
    """Returns the time limits of builds: of a day, two hours without progress."""
    return BuildLimits(settings.build_timeout_s, settings.build_timeout_s / 12)


def _source_url_options(settings: Settings) -> list[str]:
    """Tells the build process from which servers it may fetch: it does not trust the record of the build."""
    allowed = [url for url in settings.source_urls if url.startswith(("http://", "https://"))]
    return [option for url in allowed for option in ("--source-url", url)]


def _executor_options(settings: Settings) -> list[str]:
    return [] if settings.build_executor == "threads" else ["--executor", settings.build_executor]
