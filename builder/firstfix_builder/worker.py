"""Runs one build from an object store to an object store, in a process of its own.

    python -m firstfix_builder.worker --store URL --build ID --work DIR

The process may be killed at any moment, also by kill -9. Only the running stage is lost: the next run with
the same folder resumes the build, and everything that was published or recorded stays valid. It ends with
an ``ExitCode``.
"""

from __future__ import annotations

import argparse
import logging
import os
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from firstfix.builds.exit_codes import ExitCode
from firstfix.builds.limits import DEFAULT_MAX_TEMPLATES
from firstfix.builds.shared_stages import SharedStages
from firstfix.errors import (
    ClusterUnavailable,
    InvalidOption,
    NotFound,
    OutOfSpace,
    StoreError,
    StoreUnavailable,
)
from firstfix.store.store import Store

from .execution.build_trace import set_up_build_log
from .execution.executor_url import THREADS, dask_address
from .execution.stage_names import STAGES
from .job.build_job import BuildJob, BuildVersion, Built
from .job.fetch_source import DEFAULT_MAX_BYTES, SourcePolicy
from .job.run_build import run_build
from .sandbox.process import SandboxOptions
from .sandbox.sandboxed_build import SandboxedBuild

# The service that runs a worker sets these variables. They have the names of its own settings.
LOG_LEVEL_VARIABLE, LOG_JSON_VARIABLE = "FIRSTFIX_LOG_LEVEL", "FIRSTFIX_LOG_JSON"
SANDBOX_VARIABLE, MAX_MEMORY_VARIABLE = "FIRSTFIX_BUILD_SANDBOX", "FIRSTFIX_BUILD_MAX_MEMORY_BYTES"
MAX_TEMPLATES_VARIABLE = "FIRSTFIX_BUILD_MAX_TEMPLATES"
_log = logging.getLogger(__name__)


def build_here(
    job: BuildJob,
    *,
    scheduler: str | None,
    store_url: str,
    sandbox: SandboxedBuild | None,
    shared: SharedStages | None,
    max_templates: int | None = DEFAULT_MAX_TEMPLATES,
) -> Built:
    """Builds in this process, which can reach the store and the cluster.

    With a sandbox, this process parses no file of the source: the sandbox reads it first, and the result is
    in the stage cache.
    """
    from firstfix.builds.config import BuildConfig

    from .pipeline import Cluster, build_version

    if sandbox is not None:
        sandbox.read_source(job)
    return build_version(
        job.source,
        BuildConfig.parse(job.config),
        job.work / "build",
        trajectory=job.trajectory,
        progress=job.progress,
        cancelled=job.cancelled,
        shared=shared,
        cluster=None if scheduler is None else Cluster(scheduler, store_url),
        publish_provisional=job.publish_provisional,
        max_templates=max_templates,
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the build that the command line names. Returns the exit code."""
    parser = argparse.ArgumentParser(prog="firstfix_builder.worker", description="Runs one build.")
    parser.add_argument("--store", required=True, metavar="URL", help="the store of maps and builds")
    parser.add_argument("--build", required=True, metavar="ID", help="the build to run")
    parser.add_argument("--work", required=True, type=Path, metavar="DIR", help="sources and stage cache")
    parser.add_argument(
        "--max-source-bytes",
        type=int,
        default=DEFAULT_MAX_BYTES,
        metavar="N",
        help="largest size of one source file",
    )
    parser.add_argument(
        "--source-root",
        type=Path,
        action="append",
        default=[],
        metavar="DIR",
        help="allow file:// sources below this folder; may be repeated",
    )
    parser.add_argument(
        "--share-stages",
        action="store_true",
        help="fetch finished stages from the store, and put them there",
    )
    parser.add_argument(
        "--no-provisional",
        action="store_true",
        help="publish no provisional version, whatever the build's config says",
    )
    parser.add_argument(
        "--tied-to-stdin", action="store_true", help="stop as on SIGTERM when standard input ends"
    )
    parser.add_argument(
        "--source-url",
        action="append",
        default=[],
        metavar="PREFIX",
        help="allow http or https sources below this URL; may be repeated",
    )
    parser.add_argument(
        "--executor", default=THREADS, metavar="URL", help="threads, dask://HOST:PORT or dask+tls://HOST:PORT"
    )
    parser.add_argument(
        "--sandbox",
        choices=("auto", "required", "off"),
        default=os.environ.get(SANDBOX_VARIABLE, "auto"),
        help="auto: as far as the kernel supports it; required: refuse to build without it",
    )
    chosen = parser.parse_args(arguments)
    log_level = os.environ.get(LOG_LEVEL_VARIABLE, "info")
    log_json = os.environ.get(LOG_JSON_VARIABLE) == "true"
    set_up_build_log(chosen.build, level=log_level, as_json=log_json)
    max_memory = int(os.environ.get(MAX_MEMORY_VARIABLE, 0)) or None
    max_templates = int(os.environ.get(MAX_TEMPLATES_VARIABLE, DEFAULT_MAX_TEMPLATES)) or None
    try:
        shared = SharedStages(Store.open(chosen.store)) if chosen.share_stages else None
        scheduler = dask_address(chosen.executor)
        sandbox = None
        if chosen.sandbox != "off":
            options = SandboxOptions(
                required=chosen.sandbox == "required",
                max_memory_bytes=max_memory,
                max_templates=max_templates,
                log_level=log_level,
                log_json=log_json,
            )
            sandbox = SandboxedBuild(chosen.work, chosen.build, options, shared)
        if sandbox is not None and scheduler is None:
            build_version: BuildVersion = sandbox.build_version
        else:
            build_version = partial(
                build_here,
                scheduler=scheduler,
                store_url=chosen.store,
                sandbox=sandbox,
                shared=shared,
                max_templates=max_templates,
            )
        return run_build(
            chosen.store,
            chosen.build,
            chosen.work,
            build_version,
            STAGES,
            policy=SourcePolicy(chosen.max_source_bytes, tuple(chosen.source_root), tuple(chosen.source_url)),
            own_process=True,
            provisional=not chosen.no_provisional,
            tied_to_stdin=chosen.tied_to_stdin,
        )
    except (StoreUnavailable, ClusterUnavailable) as error:
        _log.error("build %s: %s", chosen.build, error)
        return ExitCode.TRY_AGAIN
    except OutOfSpace as error:
        _log.error("build %s: %s", chosen.build, error)
        return ExitCode.NO_SPACE
    except (InvalidOption, NotFound, StoreError) as error:
        _log.error("build %s: %s", chosen.build, error)
        return ExitCode.USAGE


if __name__ == "__main__":
    raise SystemExit(main())
