"""A build process that is kept ready: it has imported its libraries, is confined, and waits for a build."""

from __future__ import annotations

from dataclasses import replace

import structlog

from firstfix.builds.options import WHEN_TOLD, BuildOptions

from ..settings import Settings
from .process import BuildProcess

_log = structlog.get_logger(__name__)


class ReadyProcess:
    """The process of the next build of one work folder. For use by one event loop.

    Each build has a process of its own all the same: one that was taken is not used again. There is none
    where the settings say so, or name a build command of their own, which may not know how to wait.

    Args:
        options: of every build.
    """

    def __init__(self, settings: Settings, options: BuildOptions) -> None:
        own_command = settings.build_command == Settings.model_fields["build_command"].default
        self._is_wanted = settings.build_ready and own_command
        self._settings = settings
        self._options = options
        self._process: BuildProcess | None = None

    async def prepare(self) -> None:
        """Start the process, unless it waits already."""
        if not self._is_wanted or (self._process is not None and self._process.is_running):
            return
        try:
            self._process = await BuildProcess.start(
                self._settings, replace(self._options, build_id=WHEN_TOLD)
            )
        except OSError as error:  # a build will try again, and say why
            self._process = None
            _log.warning("no build process is kept ready", error=str(error))

    async def take(self, build_id: str) -> BuildProcess | None:
        """Let the process run a build; None: there is none, or it does not listen."""
        process, self._process = self._process, None
        if process is None:
            return None
        if await process.tell(build_id):
            return process
        await process.stop()
        return None

    async def close(self) -> None:
        """End the process."""
        process, self._process = self._process, None
        if process is not None:
            await process.stop()
            process.remove_log()
