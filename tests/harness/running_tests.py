"""Tells which tests run: when none has ended for a minute, and when the run is asked to end."""

from __future__ import annotations

import faulthandler
import os
import signal
import threading
import time
from contextlib import suppress

import psutil
import pytest

SILENT_S = 60.0
_STACKS_S = 2.0  # for a worker to print them


class RunningTests:
    """In the process that reports: the only one, or xdist's controller."""

    def __init__(self, config: pytest.Config) -> None:
        self._out = os.fdopen(os.dup(2), "w", buffering=1)  # what pytest captures is another's
        self._has_workers = bool(getattr(config.option, "tx", None))
        self._began: dict[str, float] = {}
        self._last_end = time.monotonic()
        self._over = threading.Event()
        threading.Thread(target=self._watch, name="running-tests", daemon=True).start()
        signal.signal(signal.SIGTERM, self._end)

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        self._began[nodeid] = time.monotonic()

    def pytest_runtest_logfinish(self, nodeid: str) -> None:
        self._ended(nodeid)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.when == "???":  # its worker died
            self._ended(report.nodeid)

    def pytest_unconfigure(self) -> None:
        self._over.set()

    def _ended(self, nodeid: str) -> None:
        self._began.pop(nodeid, None)
        self._last_end = time.monotonic()

    def _watch(self) -> None:
        told = self._last_end
        while not self._over.wait(min(1.0, SILENT_S / 4)):
            now = time.monotonic()
            if now - max(told, self._last_end) >= SILENT_S:
                told = now
                self._tell(f"no test has ended for {now - self._last_end:.0f} s")

    def _tell(self, why: str) -> None:
        now = time.monotonic()
        running = [f"    {nodeid}, for {now - began:.0f} s" for nodeid, began in list(self._began.items())]
        self._out.write("\n".join(["", f"{why}; running:", *(running or ["    none"]), ""]))
        self._out.flush()

    def _end(self, *_: object) -> None:
        """Prints names and stacks, then has pytest end with its summary."""
        self._tell("asked to end")
        if self._has_workers:
            for reaper in psutil.Process().children():
                with suppress(psutil.NoSuchProcess):  # that of a worker which has just ended
                    reaper.send_signal(signal.SIGUSR2)
                time.sleep(_STACKS_S)  # one after the other: printed piece by piece, they would mix
        else:
            faulthandler.dump_traceback(self._out, all_threads=True)
        pytest.exit("asked to end", returncode=pytest.ExitCode.INTERRUPTED)  # others have no summary


def pytest_configure(config: pytest.Config) -> None:
    if hasattr(config, "workerinput"):
        faulthandler.register(signal.SIGUSR2, os.fdopen(os.dup(2), "w"), all_threads=True)
    elif not config.option.collectonly:
        config.pluginmanager.register(RunningTests(config), "running_tests")
