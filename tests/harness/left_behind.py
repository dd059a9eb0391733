"""Fails the run when tests have left processes, and names them: the reaper ends them all the same."""

from __future__ import annotations

import os
import time
from contextlib import suppress

import psutil
import pytest

from tests.harness.dead_workers import REAPER

LIMIT_S = 60.0  # for processes that end by themselves once what they belong to has ended
_STEP_S = 0.05
_PYTHONS_OWN = (
    "multiprocessing.resource_tracker",
    "multiprocessing.forkserver",
)  # end with the process that uses them


class LeftBehind:
    """In each process that runs tests."""

    def __init__(self, config: pytest.Config) -> None:
        self._config = config
        parent = psutil.Process(os.getppid())
        # Orphans are the reaper's children, so what it has is all there is.
        self._root = parent if str(REAPER) in parent.cmdline() else psutil.Process()
        self._first_seen: dict[psutil.Process, str] = {}

    def pytest_runtest_teardown(self, item: pytest.Item, nextitem: pytest.Item | None) -> None:
        if nextitem is None or nextitem.path != item.path:
            file = item.nodeid.partition("::")[0]
            for process in self._processes():
                self._first_seen.setdefault(process, file)

    @pytest.hookimpl(tryfirst=True)
    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        end = time.monotonic() + LIMIT_S
        while (left := self._processes()) and time.monotonic() < end:
            time.sleep(_STEP_S)
        names = [self._name(process) for process in left]
        if hasattr(self._config, "workeroutput"):
            self._config.workeroutput["left_behind"] = names
        elif names:
            _tell(session, names)

    def _processes(self) -> list[psutil.Process]:
        found = []
        for process in self._root.children(recursive=True):
            with suppress(psutil.NoSuchProcess):
                # The command may be empty: it is for a moment when a program begins.
                command, status = " ".join(process.cmdline()), process.status()
                ours = process.pid == os.getpid() or any(own in command for own in _PYTHONS_OWN)
                if not ours and status != psutil.STATUS_ZOMBIE:
                    found.append(process)
        return found

    def _name(self, process: psutil.Process) -> str:
        with suppress(psutil.NoSuchProcess):
            command = " ".join(process.cmdline())[:200] or process.name()
            return f"{command} (first seen in {self._first_seen.get(process, 'the end of the run')})"
        return f"process {process.pid}, which has ended just now"


class OfWorkers:
    """In xdist's controller."""

    def __init__(self) -> None:
        self._names: list[str] = []

    @pytest.hookimpl(optionalhook=True)
    def pytest_testnodedown(self, node: object) -> None:
        self._names += getattr(node, "workeroutput", {}).get("left_behind", [])

    @pytest.hookimpl(trylast=True)
    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        if self._names:
            _tell(session, self._names)


def _tell(session: pytest.Session, names: list[str]) -> None:
    session.exitstatus = session.exitstatus or pytest.ExitCode.TESTS_FAILED
    reporter = session.config.pluginmanager.get_plugin("terminalreporter")
    if reporter is not None:
        reporter.write_line("")
        for name in names:
            reporter.write_line(f"left behind by the tests: {name}", red=True)


def pytest_configure(config: pytest.Config) -> None:
    controller = bool(getattr(config.option, "tx", None)) and not hasattr(config, "workerinput")
    config.pluginmanager.register(OfWorkers() if controller else LeftBehind(config), "left_behind")
