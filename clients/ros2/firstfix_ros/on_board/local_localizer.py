"""Answerer that localizes on this machine, in a process of its own: no query holds up the node."""

from __future__ import annotations

import socket
import subprocess
import sys
from dataclasses import replace
from multiprocessing.connection import Connection
from pathlib import Path
from types import TracebackType
from typing import Any

from firstfix.answer.localization import Localization
from firstfix.answer.options import LocalizeOptions
from firstfix.errors import DeadlineExceeded, FirstfixError, WorkerLost
from firstfix.scan.scan import Scan

PROCESS = "firstfix_ros.on_board.query_process"
_SEARCHED = 0.8  # of the longest wait: a hard scan is searched for so long
_END_S = 5.0  # that the process is given to end by itself


class LocalLocalizer:
    """Localizes in one version of a map. One thread at a time may call it.

    The process ends with this one, however that ends. One that is lost is started again by the next query.

    Args:
        folder: of the version, ``maps/MAP/versions/VERSION`` of a store.
        map_id: that answers name.
        timeout_s: longest wait for an answer.

    Raises:
        FirstfixError: there is no version in the folder, or it cannot be read.
        ModuleNotFoundError: the engine is not installed.
    """

    def __init__(self, folder: Path, map_id: str, *, timeout_s: float) -> None:
        self._folder, self._map_id, self._timeout_s = folder, map_id, timeout_s
        self._process: subprocess.Popen[bytes] | None = None
        self._connection: Connection | None = None
        self._start()

    def __call__(self, scan: Scan, options: LocalizeOptions, /) -> Localization:
        """The answer, as of a service with this version.

        Raises:
            FirstfixError: the scan or an option cannot be used.
            DeadlineExceeded: no answer within the longest wait.
            WorkerLost: the process has ended.
        """
        connection = self._connection or self._start()
        if options.deadline_ms is None:
            options = replace(options, deadline_ms=_SEARCHED * self._timeout_s * 1e3)
        try:
            connection.send((scan, options))
            if not connection.poll(self._timeout_s):
                self._kill()
                raise DeadlineExceeded(f"the localizer on this machine took over {self._timeout_s:g} s")
            answer: Localization = _result_of(connection)
        except (EOFError, OSError) as error:
            self._kill()
            raise WorkerLost("the localizer's process has ended, the next query starts it again") from error
        return answer

    def __enter__(self) -> LocalLocalizer:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """End the process."""
        if self._connection is not None:
            self._connection.close()
            self._connection = None
        if self._process is not None:
            try:
                self._process.wait(_END_S)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
            self._process = None

    def _start(self) -> Connection:
        """The connection to a process that has opened the version."""
        ours, theirs = socket.socketpair()
        with theirs:
            command = [sys.executable, "-m", PROCESS, str(theirs.fileno()), str(self._folder), self._map_id]
            self._process = subprocess.Popen(
                command,
                pass_fds=[theirs.fileno()],
                stdin=subprocess.DEVNULL,
                start_new_session=True,  # an interrupt from the terminal is for the node, which ends it
            )
        self._connection = Connection(ours.detach())
        try:
            _result_of(self._connection)
        except (EOFError, OSError) as error:
            self._kill()
            raise WorkerLost("the localizer's process ended while it opened the version") from error
        except (FirstfixError, ModuleNotFoundError):
            self.close()
            raise
        return self._connection

    def _kill(self) -> None:
        if self._process is not None:
            self._process.kill()
        self.close()


def _result_of(connection: Connection) -> Any:
    """The result that the process sends, or else the error that it met, raised."""
    result = connection.recv()
    if isinstance(result, Exception):
        raise result
    return result
