"""A sandbox that is started before there is a job: it is confined, imports its libraries and waits."""

from __future__ import annotations

import os
import shutil
import subprocess
import uuid
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from firstfix.builds.options import BuildOptions

from .process import PROGRAM, end_process, start_process

SCRATCH = "tmp"  # folder below <work>/build, with one folder for each sandbox


@dataclass(frozen=True)
class PreparedSandbox:
    """A running inner side that has no job yet. It is confined to its folders as any other.

    Attributes:
        messages: handle that its messages are read from.
        scratch: its folder for temporary files.
        folders: that it was given, each with what it was then: a folder made anew is not open to it.
    """

    process: subprocess.Popen[bytes]
    messages: int
    scratch: Path
    folders: dict[Path, tuple[int, int]]

    @classmethod
    def start(
        cls,
        options: BuildOptions,
        sources: Sequence[Path],
        *,
        program: Sequence[str] = PROGRAM,
        reading: bool = False,
    ) -> PreparedSandbox:
        """Start the inner side, and make the folders that it works in.

        Args:
            options, sources, program, reading: as for ``start_process``.
        """
        folder = options.work / "build"
        scratch = folder / SCRATCH / uuid.uuid4().hex
        for one in (scratch, options.work / "sources"):
            one.mkdir(parents=True, exist_ok=True)
        folders = {one: _identity(one) for one in (folder, *sources)}
        read_end, write_end = os.pipe()
        try:
            process = start_process(options, sources, scratch, write_end, program=program, reading=reading)
        except BaseException:
            os.close(read_end)
            raise
        finally:
            os.close(write_end)
        return cls(process, read_end, scratch, folders)

    @property
    def is_usable(self) -> bool:
        """Whether it runs and can reach its folders, which somebody may have removed while it waited."""
        if self.process.poll() is not None or not self.scratch.is_dir():
            return False
        return all(one.exists() and _identity(one) == then for one, then in self.folders.items())

    def end(self) -> None:
        """Kill it with all that it started, and remove its temporary files."""
        end_process(self.process)  # from here on nothing changes its files
        os.close(self.messages)
        shutil.rmtree(self.scratch, ignore_errors=True)
        with suppress(OSError):  # another sandbox has its folder there
            self.scratch.parent.rmdir()


def _identity(folder: Path) -> tuple[int, int]:
    """Device and inode: what the kernel's rules of a sandbox name."""
    status = folder.stat()
    return status.st_dev, status.st_ino
