"""Memory of the last fix that a robot was given. On the disk it outlives the gateway."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path
from urllib.parse import quote

from .given_fix import GivenFix

MAX_FILE_BYTES = 2**16
_MAX_NAME_CHARACTERS = 200  # of a file


def user_memory(domain: int) -> Path | None:
    """The folder of a ROS domain among the states of this user; None: the user has no folder."""
    root = os.environ.get("XDG_STATE_HOME")
    if not root:
        try:
            root = str(Path.home() / ".local" / "state")
        except RuntimeError:
            return None
    return Path(root) / "firstfix" / "first-fixes" / f"domain-{domain}"


class FixMemory:
    """The last given fix of one robot. Its methods are called by one thread.

    Args:
        folder: holds one file for each robot; None: the memory ends with the process.
        robot: the robot's namespace.
        log_line: takes a line when the file cannot be read or written. The gateway then goes on without it.
    """

    def __init__(self, folder: Path | None, robot: str, log_line: Callable[[str], None]) -> None:
        name = quote(robot.strip("/"), safe="")[:_MAX_NAME_CHARACTERS] or "%2F"
        self._path = None if folder is None else folder / f"{name}.json"
        self._log_line = log_line
        self._last = self._read()

    @property
    def last(self) -> GivenFix | None:
        """The last given fix; None if there was none."""
        return self._last

    def keep(self, given: GivenFix) -> None:
        """Keep a fix in the place of the one before. A crash leaves one of the two."""
        self._last = given
        if self._path is None:
            return
        new = self._path.with_suffix(f".{os.getpid()}.new")
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            with new.open("w", encoding="utf-8") as file:
                json.dump(given.to_mapping(), file)
                file.flush()
                os.fsync(file.fileno())
            new.replace(self._path)
        except OSError as error:
            self._log_line(f"the fix is not remembered over a restart of the gateway: {error}")

    def _read(self) -> GivenFix | None:
        if self._path is None:
            return None
        try:
            with self._path.open("rb") as file:
                body = file.read(MAX_FILE_BYTES + 1)
            if len(body) > MAX_FILE_BYTES:
                raise ValueError(f"more than {MAX_FILE_BYTES} bytes")
            return GivenFix.from_mapping(json.loads(body))
        except FileNotFoundError:
            return None
        except (OSError, ValueError, KeyError, TypeError, OverflowError, RecursionError) as error:
            self._log_line(f"{self._path} is not used: {error!r}")
            return None
