"""Blocking calls about builds."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from ..records import BuildStatus
from .base import HttpCalls

DAY_S = 24 * 3600.0


class BuildCalls(HttpCalls):
    """Calls about uploads and builds. Part of ``Client``; of ``ZenohClient`` with a URL."""

    def build_map(
        self,
        path: Path | str,
        map_id: str,
        *,
        config: Mapping[str, Any] | None = None,
        trajectory: Path | str | None = None,
        progress: Callable[[BuildStatus], None] | None = None,
        upload_timeout_s: float = 3600.0,
        timeout_s: float = DAY_S,
    ) -> BuildStatus:
        """Uploads a map file and starts its build.

        One build is started, however often the connection breaks. Files of 64 MiB and more are sent in
        parts; a part that arrived is not sent again.

        Args:
            config: build config, with the keys of its YAML file; None: the service's defaults.
            trajectory: file with the poses of the mapping run.
            progress: called about once a second until the build ends. None: do not wait for the build;
                follow it with ``wait_for_build`` or ``build_events``.
            timeout_s: limit for the build itself, if it is waited for.

        Raises:
            NotFound: no such file.
            InputError: the service cannot use the file or the config.
            BuildFailed, BuildCancelled: the build ended without a version.
        """
        steps = self._http.steps.builds.build_map(
            path, map_id, config, trajectory, progress, upload_timeout_s, timeout_s
        )
        return self._http.run(steps)

    def builds(self, *, map_id: str | None = None, state: str | None = None) -> Iterator[BuildStatus]:
        """Yields the recorded builds, newest first. Pages are fetched as they are needed."""
        return self._http.items(self._http.steps.builds.builds(map_id, state))

    def build_status(self, build_id: str) -> BuildStatus:
        """Returns the state of a build.

        Raises:
            NotFound: no such build.
        """
        return self._http.run(self._http.steps.builds.build_status(build_id))

    def build_events(self, build_id: str, *, timeout_s: float = DAY_S) -> Iterator[BuildStatus]:
        """Yields the build's status whenever it changes; the last one is final.

        Raises:
            NotFound: no such build.
            DeadlineExceeded: the build has not ended yet; it goes on.
        """
        return self._http.items(self._http.steps.builds.build_events(build_id, timeout_s))

    def wait_for_build(
        self,
        build_id: str,
        *,
        progress: Callable[[BuildStatus], None] = lambda status: None,
        timeout_s: float = DAY_S,
    ) -> BuildStatus:
        """Waits until the build has published its version; calls ``progress`` about once a second.

        Raises:
            BuildFailed, BuildCancelled: the build ended without a version.
            DeadlineExceeded: the build has not ended yet; it goes on.
        """
        return self._http.run(self._http.steps.builds.wait_for_build(build_id, progress, timeout_s))

    def cancel_build(self, build_id: str) -> None:
        """Cancels a build. It stops a moment later.

        Raises:
            NotFound: no such build.
            Conflict: the build has ended.
        """
        self._http.run(self._http.steps.builds.cancel_build(build_id))
