"""Runs one build from an object store to an object store, in a process of its own.

    python -m firstfix_builder.worker --store URL --build ID --work DIR

With ``--build -`` it makes itself and its sandbox ready, and waits for the build's id at standard input.
The process may be killed at any moment, also by kill -9. Only the running stage is lost: the next run with
the same folder resumes the build, and everything that was published or recorded stays valid. It ends with
an ``ExitCode``.
"""

from __future__ import annotations

import logging
import os
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial

from firstfix.builds.options import WHEN_TOLD, BuildOptions, ExitCode
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
MAX_ID_BYTES = 256


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
        with _prepared(options) as sandbox:
            if options.build_id == WHEN_TOLD:
                build_id = _told_build()
                if build_id is None:
                    return ExitCode.SUCCEEDED
                options = replace(options, build_id=build_id)
                set_up_build_log(options)
                if sandbox is not None:
                    sandbox.build_id = build_id
            build_version: BuildVersion = partial(build_here, options, sandbox)
            if sandbox is not None and options.scheduler is None:
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


@contextmanager
def _prepared(options: BuildOptions) -> Iterator[SandboxedBuild | None]:
    """The build's sandbox, which imports its libraries while the source is fetched; None: there is none."""
    if options.sandbox == "off":
        yield None
        return
    sandbox = SandboxedBuild(options)
    try:
        if options.scheduler is None:
            sandbox.prepare()
        yield sandbox
    finally:
        sandbox.close()


def _told_build() -> str | None:
    """The build's id, the first line of standard input, of which no more is read; None: it has ended."""
    line = b""
    while not line.endswith(b"\n"):
        byte = os.read(0, 1)
        if not byte or len(line) > MAX_ID_BYTES:
            return None
        line += byte
    return line.decode("utf-8", errors="replace").strip()


if __name__ == "__main__":
    raise SystemExit(main())
