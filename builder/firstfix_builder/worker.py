"""Runs one build from an object store to an object store, in a process of its own.

    python -m firstfix_builder.worker --store URL --build ID --work DIR

The process may be killed at any moment, also by kill -9. Only the running stage is lost: the next run with
the same folder resumes the build, and everything that was published or recorded stays valid. It ends with
an ``ExitCode``.
"""

from __future__ import annotations

import logging
import shutil
from collections.abc import Sequence
from functools import partial

from firstfix.builds.options import BuildOptions, ExitCode
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
from .job.build_job import BuildJob, BuildResult, BuildVersion
from .job.run_build import run_build
from .sandbox.sandboxed_build import SandboxedBuild

_log = logging.getLogger(__name__)


def build_here(options: BuildOptions, sandbox: SandboxedBuild | None, job: BuildJob) -> BuildResult:
    """Build in this process, which can reach the store and the cluster.

    With a sandbox, this process parses no file of the source: the sandbox reads it first, and the result is
    in the stage cache.
    """
    from firstfix.builds.config import BuildConfig

    from .pipeline import CONFIRMED, build_version

    try:
        if sandbox is not None:
            sandbox.read_source(job)
        return build_version(
            job.source,
            BuildConfig.parse(job.config),
            job.work / "build",
            trajectory=job.trajectory,
            confirmed=job.confirmed,
            base=job.base,
            progress=job.progress,
            cancelled=job.cancelled,
            shared=SharedStages(Store.open(options.store)) if options.share_stages else None,
            publish_provisional=job.publish_provisional,
            options=options,
        )
    finally:  # scans of robots, which the sandbox has decoded, however the build ends
        shutil.rmtree(job.work / "build" / CONFIRMED, ignore_errors=True)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the build that the command line names. Returns the exit code."""
    options = BuildOptions.from_arguments(arguments)
    set_up_build_log(options)
    try:
        is_local = options.scheduler is None
        sandbox = None if options.sandbox == "off" else SandboxedBuild(options)
        build_version: BuildVersion = partial(build_here, options, sandbox)
        if sandbox is not None and is_local:
            build_version = sandbox.build_version
        return run_build(options, build_version, own_process=True)
    except (StoreUnavailable, ClusterUnavailable) as error:
        _log.error("build %s: %s", options.build_id, error)
        return ExitCode.TRY_AGAIN
    except OutOfSpace as error:
        _log.error("build %s: %s", options.build_id, error)
        return ExitCode.NO_SPACE
    except (InvalidOption, NotFound, StoreError) as error:
        _log.error("build %s: %s", options.build_id, error)
        return ExitCode.USAGE


if __name__ == "__main__":
    raise SystemExit(main())
