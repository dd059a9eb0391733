"""Costly things that several test files share: made once a run, on disk, for all workers.

Runs that go on from each other, as those of `make test-all`, share them too: ONCE_A_RUN names their folder.
"""

from __future__ import annotations

import fcntl
import os
import shutil
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from firstfix_builder.job.build_job import BuildResult

_DONE = ".done"


class OnceARun:
    """Folders that one worker fills and all read. A test that changes one works on a copy of its own.

    A lock of the kernel stands for "it is being made": it ends with the process that holds it, so
    one that is killed leaves nobody waiting, and the next one makes the folder anew.
    """

    def __init__(self, root: Path) -> None:
        self._root = root

    def folder(self, name: str, make: Callable[[Path], object]) -> Path:
        """The folder of that name, which ``make`` filled: here and now, or in another worker.

        Args:
            make: is given the empty folder. Its path is the same for all, so what is in it may tell of it.
        """
        folder = self._root / name
        folder.parent.mkdir(parents=True, exist_ok=True)
        with Path(f"{folder}.lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not (folder / _DONE).exists():
                shutil.rmtree(folder, ignore_errors=True)
                folder.mkdir()
                make(folder)
                (folder / _DONE).touch()
        return folder

    def version(
        self, name: str, source: Callable[[Path], Path], config: Mapping[str, Any], **more: Any
    ) -> BuildResult:
        """A map's version, built in the folder of that name, whose ``stages`` other builds may start from.

        Args:
            source: returns the map's file, which it may write into the folder.
            more: further arguments of ``build_version``.
        """
        from firstfix.builds.config import BuildConfig
        from firstfix.catalog.manifest import Manifest
        from firstfix_builder.job.build_job import BuildResult
        from firstfix_builder.pipeline import build_version

        def build(folder: Path) -> None:
            build_version(source(folder), BuildConfig.parse(config), folder, **more)

        directory = self.folder(name, build) / "version"
        return BuildResult(directory, Manifest.from_json((directory / "manifest.json").read_bytes()))


@pytest.fixture(scope="session")
def once_a_run(tmp_path_factory: pytest.TempPathFactory) -> OnceARun:
    """Folders that all workers of this run share."""
    if shared := os.environ.get("ONCE_A_RUN"):
        return OnceARun(Path(shared))
    base = tmp_path_factory.getbasetemp()
    of_run = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base
    return OnceARun(of_run / "once-a-run")
