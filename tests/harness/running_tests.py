"""Tells which tests run: when none has ended for a minute, and when the run is asked to end."""

from __future__ import annotations

import faulthandler
import os
import signal
import threading
import time
from contextlib import suppress
from typing import TYPE_CHECKING

import psutil
import pytest

if TYPE_CHECKING:
    from xdist.workermanage import WorkerController

SILENT_S = 60.0
_STACKS_S = 10.0  # a worker that is stopped, or not yet set up, has none
_STEP_S = 0.02


class RunningTests:
    """In the process that reports: the only one, or xdist's controller."""

    def __init__(self, config: pytest.Config) -> None:
        self._out = os.fdopen(os.dup(2), "w", buffering=1)  # what pytest captures is another's
        self._has_workers = bool(getattr(config.option, "tx", None))
        self._began: dict[str, float] = {}
        self._last_end = time.monotonic()
        self._over = threading.Event()
        self._stacks: dict[WorkerController, int] = {}  # descriptors
        threading.Thread(target=self._watch, name="running-tests", daemon=True).start()
        signal.signal(signal.SIGTERM, self._end)

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        self._began[nodeid] = time.monotonic()

    def pytest_runtest_logfinish(self, nodeid: str) -> None:
        self._ended(nodeid)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.when == "???":  # its worker died
            self._ended(report.nodeid)

    @pytest.hookimpl(optionalhook=True)
    def pytest_configure_node(self, node: WorkerController) -> None:
        """Gives a worker a file in memory for its stacks.

        Into one pipe, workers would print at once, piece by piece, and names would be torn from their lines.
        """
        self._stacks[node] = os.memfd_create("stacks")
        node.workerinput["stacks"] = f"/proc/{os.getpid()}/fd/{self._stacks[node]}"

    @pytest.hookimpl(optionalhook=True)
    def pytest_testnodedown(self, node: WorkerController) -> None:
        os.close(self._stacks.pop(node))

    @pytest.hookimpl(trylast=True)
    def pytest_sessionfinish(self) -> None:
        """Prints the stacks that were asked for. They are whole: xdist has ended the workers."""
        for node, file in self._stacks.items():
            if stacks := os.pread(file, os.fstat(file).st_size, 0):
                self._out.write(f"\nstacks of {node.gateway.id}:\n{stacks.decode(errors='replace')}")
        self._out.flush()

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
        self._over.set()  # nothing else is told between the lines
        self._tell("asked to end")
        if self._has_workers:
            for reaper in psutil.Process().children():
                with suppress(psutil.NoSuchProcess):  # that of a worker which has just ended
                    reaper.send_signal(signal.SIGUSR2)
            end = time.monotonic() + _STACKS_S
            while not self._all_have_begun_to_print() and time.monotonic() < end:
                time.sleep(_STEP_S)
        else:
            faulthandler.dump_traceback(self._out, all_threads=True)
        pytest.exit("asked to end", returncode=pytest.ExitCode.INTERRUPTED)  # others have no summary

    def _all_have_begun_to_print(self) -> bool:
        return all(os.fstat(file).st_size for file in self._stacks.values())


def pytest_configure(config: pytest.Config) -> None:
    if hasattr(config, "workerinput"):
        stacks = os.open(config.workerinput["stacks"], os.O_WRONLY)
        faulthandler.register(signal.SIGUSR2, stacks, all_threads=True)
    elif not config.option.collectonly:
        config.pluginmanager.register(RunningTests(config), "running_tests")
