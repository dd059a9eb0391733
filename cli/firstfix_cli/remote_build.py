"""Builds that a service runs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from .arguments import client_of
from .map_source import as_one_file
from .stage_bars import Progress

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
            started = client.build_map(file, map_id, config=config or None, trajectory=trajectory)
        said = {"map_id": map_id, "build_id": started.build_id}
        if not wait:
            return {**said, "state": started.state, "waits_for": started.waits_for}
        with progress() as tell:
            told: str | None = None

            def follow(status: BuildStatus) -> None:
                nonlocal told
                tell(status.stage or status.state, status.progress)
                if status.waits_for not in (None, told):
                    tell.say(f"the build waits: {status.waits_for}")
                told = status.waits_for

            done = client.wait_for_build(started.build_id, progress=follow)
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
