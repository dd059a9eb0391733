"""The client's calls about builds."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from ..records import BuildStatus
from .http_calls import HttpCalls

DAY_S = 24 * 3600.0


class BuildCalls(HttpCalls):
    """Handing maps in, and following what becomes of them. Part of ``Client`` and, with a URL, of
    ``ZenohClient``."""

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

        However often a connection breaks on the way, it is one build. Files of 64 MiB and more go in
        parts, of which none is sent twice.

        Args:
            config: of the build, as its YAML file would say it; None: the service's defaults.
            progress: told how far it is, about once a second, until the version is there. None: it is not
                waited for; ``wait_for_build`` or ``build_events`` follow it.
            timeout_s: for the build itself, where it is waited for.

        Raises:
            NotFound: no such file.
            InputError: the service cannot use the file or the config.
            BuildFailed, BuildCancelled: it was waited for and ended without a version.
        """
        steps = self._http.steps.builds.build_map(
            path, map_id, config, trajectory, progress, upload_timeout_s, timeout_s
        )
        return self._http.run(steps)

    def builds(self, *, map_id: str | None = None, state: str | None = None) -> Iterator[BuildStatus]:
        """Builds on record, newest first, asked for page by page as they are taken."""
        return self._http.items(self._http.steps.builds.builds(map_id, state))

    def build_status(self, build_id: str) -> BuildStatus:
        """
        Raises:
            NotFound: no such build.
        """
        return self._http.run(self._http.steps.builds.build_status(build_id))

    def build_events(self, build_id: str, *, timeout_s: float = DAY_S) -> Iterator[BuildStatus]:
        """The build's status whenever it changes, as the service tells it; the last one is final.

        Raises:
            NotFound: no such build.
            DeadlineExceeded: it is not done yet; it goes on all the same.
        """
        return self._http.items(self._http.steps.builds.build_events(build_id, timeout_s))

    def wait_for_build(
        self,
        build_id: str,
        *,
        progress: Callable[[BuildStatus], None] = lambda status: None,
        timeout_s: float = DAY_S,
    ) -> BuildStatus:
        """Waits for the build's version, telling ``progress`` about once a second.

        Raises:
            BuildFailed, BuildCancelled: it ended without a version.
            DeadlineExceeded: it is not done yet; it goes on all the same.
        """
        return self._http.run(self._http.steps.builds.wait_for_build(build_id, progress, timeout_s))

    def cancel_build(self, build_id: str) -> None:
        """Asks a build to stop; it does so at its next tick.

        Raises:
            NotFound: no such build.
            Conflict: it has ended.
        """
        self._http.run(self._http.steps.builds.cancel_build(build_id))
