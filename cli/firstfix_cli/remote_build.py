"""Builds that a service runs."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .arguments import client_of
from .map_source import as_one_file
from .stage_bars import Progress, StageProgress

if TYPE_CHECKING:
    from firstfix_client import BuildStatus


def remote_build(
    source: Path,
    map_id: str,
    config: dict[str, Any],
    trajectory: Path | None,
    url: str | None,
    progress: Progress,
    *,
    note: str = "",
    wait: bool,
) -> dict[str, Any]:
    """Build a map in the service. Returns facts about its version, or about the build if not waited for.

    A folder is sent as a zip archive.

    Args:
        config: the given values; the service has defaults for the others.
        progress: opens a display of the stages' progress.

    Raises:
        BuildFailed, BuildCancelled: the build ended without a version.
    """
    with client_of(url) as client:
        with as_one_file(source) as file:
            started = client.build_map(file, map_id, config=config or None, trajectory=trajectory, note=note)
        said = {"map_id": map_id, "build_id": started.build_id}
        if not wait:
            return {**said, "state": started.state, "waits_for": started.waits_for}
        with progress() as tell:
            done = client.wait_for_build(started.build_id, progress=follower(tell))
        report = client.report(map_id, str(done.version))
        ended = client.build_status(started.build_id)
    return {
        **said,
        "version": done.version,
        **report,
        "activated": ended.activated,
        "findings": [one.to_mapping() for one in ended.findings],
        "stages": [dict(stage) for stage in ended.stages],
    }


def follower(tell: StageProgress) -> Callable[[BuildStatus], None]:
    """A function that shows each status of a build, and why it waits."""
    told: str | None = None

    def follow(status: BuildStatus) -> None:
        nonlocal told
        tell(status.stage or status.state, status.progress)
        why = status.waits_for or (status.error_detail if status.state == "queued" else None)
        if why not in (None, told):
            tell.say(f"the build waits: {why}")
        told = why

    return follow
