"""Builds that a service runs."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from firstfix.errors import InvalidOption

from .arguments import client_of

if TYPE_CHECKING:
    from firstfix_client import BuildStatus

Progress = Callable[[], AbstractContextManager[Callable[[str, float], None]]]


def remote_build(
    source: Path,
    map_id: str,
    config: dict[str, Any],
    trajectory: Path | None,
    url: str | None,
    progress: Progress,
    *,
    wait: bool,
) -> dict[str, Any]:
    """Builds a map in the service. Returns facts about its version, or about the build if not waited for.

    Args:
        config: the given values; the service has defaults for the others.
        progress: opens a display of the stages' progress.

    Raises:
        InvalidOption: the source is a folder, but a service takes one file.
        BuildFailed, BuildCancelled: the build ended without a version.
    """
    if source.is_dir():
        raise InvalidOption(
            f"{source} is a folder, but a service takes one file; use --store to build it on this machine"
        )
    with client_of(url) as client:
        started = client.build_map(source, map_id, config=config or None, trajectory=trajectory)
        said = {"map_id": map_id, "build_id": started.build_id}
        if not wait:
            return {**said, "state": started.state}
        with progress() as tell:

            def follow(status: BuildStatus) -> None:
                tell(status.stage or status.state, status.progress)

            done = client.wait_for_build(started.build_id, progress=follow)
        report = client.report(map_id, str(done.version))
        stages = [dict(stage) for stage in client.build_status(started.build_id).stages]
    return {**said, "version": done.version, **report, "stages": stages}
