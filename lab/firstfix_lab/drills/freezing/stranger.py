"""A process beside the deployment that asks for much, and is frozen before it takes it."""

from __future__ import annotations

import signal
import subprocess
import sys

from .part import Effect


class Stranger:
    """A script that asks, prints "asked", and then takes its answers. It comes when it is to be frozen."""

    effect = Effect()  # nobody depends on it

    def __init__(self, name: str, script: str, *arguments: str) -> None:
        self.name = name
        self._command = [sys.executable, "-c", script, *arguments]
        self._process: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        """Do nothing: it comes when it is to be frozen."""

    def freeze(self) -> None:
        self.kill()
        self._process = subprocess.Popen(self._command, stdout=subprocess.PIPE)
        assert self._process.stdout is not None
        if (said := self._process.stdout.readline()) != b"asked\n":
            raise RuntimeError(f"{self.name} said {said!r}")
        self._process.send_signal(signal.SIGSTOP)

    def thaw(self) -> None:
        assert self._process is not None
        self._process.send_signal(signal.SIGCONT)

    def kill(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.communicate()
            self._process = None
