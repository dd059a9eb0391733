"""A worker of xdist that dies takes its processes with it, fails the test that it ran, and is replaced.

xdist 3.8 with ``--dist loadfile`` alone runs that test again in each new worker, and waits for ever once a
new worker is given a file with one test left: a worker begins its last test when it is given more or told
to end, and gets neither.
"""

from __future__ import annotations

import shlex
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from xdist.scheduler.loadfile import LoadFileScheduling

if TYPE_CHECKING:
    from execnet import XSpec
    from xdist.workermanage import WorkerController

REAPER = Path(__file__).with_name("reaper.py")

# They need the Docker engine, which one process has at a time: in one worker, no other waits for it. Together
# they take longer than all else, so they begin first.
OF_THE_ENGINE = {
    "tests/deploy/test_images.py",
    "tests/deploy/test_smoke.py",
    "plugins/fleet/tests/robots/test_composed_gateway.py",
}

# One browser and one service for all of them.
OF_THE_CONSOLE = "plugins/console/tests/test_console_"


class FilesOfTheDead(LoadFileScheduling):
    """Files go to one worker each. What a dead one had not begun goes to another."""

    def _split_scope(self, nodeid: str) -> str:
        file = super()._split_scope(nodeid)
        if file.startswith(OF_THE_CONSOLE):
            return "the console's"
        return "the engine's" if file in OF_THE_ENGINE else file

    def remove_node(self, node: WorkerController) -> str | None:
        """Takes the worker out; returns the test in which it died, which is not run again."""
        work = self.assigned_work[node]
        begun = next((test for tests in work.values() for test, done in tests.items() if not done), None)
        if begun is not None:
            work[self._split_scope(begun)][begun] = True
            for file in [file for file, tests in work.items() if all(tests.values())]:
                del work[file]
        super().remove_node(node)
        return begun

    def _reschedule(self, node: WorkerController) -> None:
        """Gives the worker files until it has two tests, so that it begins the first of them."""
        super()._reschedule(node)
        while self.workqueue and not node.shutting_down and self._pending_of(self.assigned_work[node]) < 2:
            self._assign_work_unit(node)
        if not self.workqueue:
            node.shutdown()  # once it has done what it has


class DeadWorkers:
    """Hooks of xdist."""

    @pytest.hookimpl
    def pytest_xdist_setupnodes(self, specs: Sequence[XSpec]) -> None:
        """Has each worker of this machine, and those that replace it, run under a reaper of its own."""
        for spec in specs:
            if spec.popen:
                spec.python = shlex.join([sys.executable, str(REAPER), spec.python or sys.executable])

    @pytest.hookimpl
    def pytest_xdist_make_scheduler(self, config: pytest.Config, log: object) -> FilesOfTheDead | None:
        """Takes the place of xdist's scheduler of files."""
        return FilesOfTheDead(config, log) if config.getvalue("dist") == "loadfile" else None


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Puts the engine's files first, in whatever order the others are."""
    items.sort(key=lambda item: item.nodeid.partition("::")[0] not in OF_THE_ENGINE)


def pytest_configure(config: pytest.Config) -> None:
    if config.pluginmanager.hasplugin("xdist"):
        config.pluginmanager.register(DeadWorkers(), "dead_workers")
