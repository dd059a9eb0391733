"""A map built by a service: handed in, followed, told like one that was built here."""

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
    """What there is to say of the version, or, if it is not waited for, of the build.

    Args:
        config: as far as it is given; the rest is the service's.
        progress: opens what is told of stages and their shares.

    Raises:
        InvalidOption: a folder: a service takes one file.
        BuildFailed, BuildCancelled: it ended without a version.
    """
    if source.is_dir():
        raise InvalidOption(f"{source} is a folder: a service takes one file; --store builds folders here")
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
    return {**said, "version": done.version, **report}
