"""The first stage of a local build in the sandbox of the build workers: it parses files of unknown origin."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from firstfix.builds.limits import default_build_memory_bytes
from firstfix.builds.options import BuildOptions

if TYPE_CHECKING:
    from firstfix_builder.job.build_job import BuildJob


def build_memory_bytes() -> int | None:
    """The memory that a local build may take; None: no limit."""
    given = os.environ.get("FIRSTFIX_BUILD_MAX_MEMORY_BYTES")
    return (default_build_memory_bytes() if given is None else int(given)) or None


def read_confined(job: BuildJob, options: BuildOptions) -> None:
    """Read the job's source. The result is in the stage cache of ``<options.work>/build``.

    Raises:
        InputError: the source cannot be read.
        BuildFailed: the reader took too much memory, or crashed.
    """
    from firstfix_builder.sandbox.sandboxed_build import SandboxedBuild

    sources = [path for path in (job.source, job.trajectory, job.confirmed) if path is not None]
    readable = [one for path in sources for one in _with_targets(path)]
    SandboxedBuild(options, sources=readable).read_source(job)


def _with_targets(path: Path) -> Iterator[Path]:
    """The path, and where links in a folder lead to."""
    yield path
    if path.is_dir():
        yield from (one.resolve() for one in path.rglob("*") if one.is_symlink())
