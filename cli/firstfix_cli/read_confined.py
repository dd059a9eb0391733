"""The first stage of a local build in the sandbox of the build workers: it parses files of unknown origin."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from firstfix.builds.limits import default_build_memory_bytes

if TYPE_CHECKING:
    from firstfix_builder.job.build_job import BuildJob

_MEMORY_VARIABLE = "FIRSTFIX_BUILD_MAX_MEMORY_BYTES"


def read_confined(job: BuildJob, max_templates: int) -> None:
    """Reads the job's source. The result is in the stage cache of ``<job.work>/build``.

    Raises:
        InputError: the source cannot be read.
        BuildFailed: the reader took too much memory, or crashed.
    """
    from firstfix_builder.sandbox.process import SandboxOptions
    from firstfix_builder.sandbox.sandboxed_build import SandboxedBuild

    given = os.environ.get(_MEMORY_VARIABLE)
    options = SandboxOptions(
        required=False,
        max_memory_bytes=(default_build_memory_bytes() if given is None else int(given)) or None,
        max_templates=max_templates or None,
        log_level="critical",  # what went wrong is in the error
    )
    sources = [path for path in (job.source, job.trajectory) if path is not None]
    readable = [one for path in sources for one in _with_targets(path)]
    SandboxedBuild(job.work, "", options, sources=readable).read_source(job)


def _with_targets(path: Path) -> Iterator[Path]:
    """The path, and where links in a folder lead to."""
    yield path
    if path.is_dir():
        yield from (one.resolve() for one in path.rglob("*") if one.is_symlink())
