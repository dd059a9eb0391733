"""A build process that is kept ready: it has imported its libraries, is confined, and waits for a build."""

from __future__ import annotations

import time
from dataclasses import replace

import structlog

from firstfix.builds.options import WHEN_TOLD, BuildOptions

from ..settings import Settings
from .process import BuildProcess

_log = structlog.get_logger(__name__)
ENDS_AT_ONCE_S = 60.0  # a process that ends sooner cannot wait: another one would not either
MAX_SAID_CHARS = 1000  # of the log of such a process


class ReadyProcess:
    """The process of the next build of one work folder. For use by one event loop.

    Each build has a process of its own all the same: one that was taken is not used again. There is none
    where the settings say so, or name a build command of their own, which may not know how to wait.

    Args:
        options: of every build.
    """

    def __init__(self, settings: Settings, options: BuildOptions) -> None:
        is_ours = settings.build_command == Settings.model_fields["build_command"].default
        self._is_wanted = settings.build_ready and is_ours
        self._settings = settings
        self._options = options
        self._process: BuildProcess | None = None
        self._started = 0.0
        self._cannot_wait = False  # until a build has run, which says why

    async def prepare(self) -> None:
        """Start the process, unless it waits already, or cannot wait."""
        if not self._is_wanted or self._cannot_wait:
            return
        if self._process is not None:
            if self._process.is_running:
                return
            if time.monotonic() - self._started < ENDS_AT_ONCE_S:
                self._cannot_wait = True
                _log.warning(
                    "a build process that should wait has ended",
                    log=self._process.end_of_log()[-MAX_SAID_CHARS:],
                )
                return
        self._started = time.monotonic()
        try:
            self._process = await BuildProcess.start(
                self._settings, replace(self._options, build_id=WHEN_TOLD)
            )
        except OSError as error:  # a build will try again, and say why
            self._process, self._cannot_wait = None, True
            _log.warning("no build process is kept ready", error=str(error))

    async def take(self, build_id: str) -> BuildProcess | None:
        """Let the process run a build; None: there is none, or it does not listen."""
        process, self._process, self._cannot_wait = self._process, None, False
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
