"""The worker's side of a build in its sandbox: starts it, tells it the job, and takes over what it made.

<work>/sources/    what the build reads
<work>/build/      what it writes: stages, chunks, the version
<work>/taken/      what this side took over, or brings; the build does not get there
"""

from __future__ import annotations

import logging
import math
import os
import shutil
import signal
import subprocess
import sys
import time
import uuid
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from firstfix.builds.shared_stages import SharedStages
from firstfix.catalog.manifest import FILE_NAME, MAX_BYTES, Manifest
from firstfix.errors import BuildFailed, CorruptVersion, FirstfixError

from ..execution.build_trace import current_build, mark_cached
from ..execution.stage_names import STAGES
from .failures import as_error, of_exit
from .hand_over import take_files
from .messages import Lines, Speaker
from .process_group import too_many_processes, wait_until_ended

_log = logging.getLogger(__name__)
LOOK_S = 0.2
END_WITHIN_S = 20.0  # of a process that was killed
PROGRAM = ("-m", "firstfix_builder.sandbox.inside")
MIN_FILE_BYTES = 1 << 30
MIN_MEMORY_BYTES = 4 << 30  # that libraries reserve for threads and heaps
# All that a build may know of this process's environment: how to find Python and its libraries.
_PASSED = ("PATH", "LANG", "LC_ALL", "TZ", "PYTHONPATH", "PYTHONUNBUFFERED", "PYTHONDONTWRITEBYTECODE")
_PASSED_PREFIXES = ("OMP_", "OPENBLAS_", "MKL_", "LD_LIBRARY_", "MPL")


@dataclass(frozen=True)
class Built:
    directory: Path
    manifest: Manifest


class SandboxedBuild:
    """Runs one build in its sandbox, while nothing else runs in the folder.

    Args:
        work: the worker's folder.
        required: where the kernel lacks a means, no build is run.
        max_memory_bytes: of all its processes, to which the service holds them; one of them may reserve twice
            as much, used or not. None: what the machine has.
        program: of the inner side, after Python's name.
    """

    def __init__(
        self,
        work: Path,
        build_id: str,
        *,
        required: bool,
        shared: SharedStages | None,
        max_memory_bytes: int | None,
        log_level: str,
        log_json: bool,
        program: tuple[str, ...] = PROGRAM,
    ) -> None:
        self._work = work.absolute()
        self._folder = self._work / "build"
        self._sources = self._work / "sources"
        self._taken = self._work / "taken"
        self._about = {"build_id": build_id, "log_level": log_level, "log_json": log_json}
        self._required = required
        self._program = program
        self._shared = shared
        all_bytes = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
        self._memory_bytes = max(2 * (max_memory_bytes or all_bytes), MIN_MEMORY_BYTES)
        self._stage = STAGES[0]

    def build_version(
        self,
        source: Path,
        config: dict[str, Any],
        work: Path,
        *,
        trajectory: Path | None,
        progress: Callable[[str, float], None],
        cancelled: Callable[[], bool],
    ) -> Built:
        """As ``pipeline.build_version``, of files below ``<work>/sources``.

        Raises:
            InputError: the source cannot be read.
            BuildFailed: a stage could not do its work, or the sandbox ended it.
            BuildCancelled: cancelled() said so.
        """
        self._run(source, config, trajectory, progress, cancelled, read_only=False)
        taken = self._taken / "version"
        take_files(self._folder, "version", taken)
        record = taken / FILE_NAME
        if not record.is_file() or record.stat().st_size > MAX_BYTES:
            raise BuildFailed("the build made no version")
        try:
            manifest = Manifest.from_json(record.read_bytes())
            manifest.verify_directory(taken)
        except CorruptVersion as error:
            raise BuildFailed(f"the build made no version: {error}") from None
        return Built(taken, manifest)

    def read_source(
        self,
        source: Path,
        config: dict[str, Any],
        *,
        trajectory: Path | None,
        progress: Callable[[str, float], None],
        cancelled: Callable[[], bool],
    ) -> Path:
        """The first stage alone, which reads what a stranger wrote.

        Returns:
            the folder in whose stage cache the result stands.
        """
        self._run(source, config, trajectory, progress, cancelled, read_only=True)
        return self._folder

    def _run(
        self,
        source: Path,
        config: dict[str, Any],
        trajectory: Path | None,
        progress: Callable[[str, float], None],
        cancelled: Callable[[], bool],
        *,
        read_only: bool,
    ) -> None:
        shutil.rmtree(self._taken, ignore_errors=True)
        scratch = self._folder / "tmp"
        shutil.rmtree(scratch, ignore_errors=True)
        for left in self._folder.glob("fetched-*"):
            shutil.rmtree(left, ignore_errors=True)
        for folder in (scratch, self._folder / "home", self._sources, self._taken):
            folder.mkdir(parents=True, exist_ok=True)
        heard, said = os.pipe()
        try:
            process = self._start(said, scratch)
        except BaseException:
            os.close(heard)
            raise
        finally:
            os.close(said)
        try:
            self._hear(process, heard, self._job(source, config, trajectory, read_only), progress, cancelled)
        finally:
            _end(process)  # with all that it started: from here on nothing changes its files
            os.close(heard)
            shutil.rmtree(scratch, ignore_errors=True)

    def _start(self, said: int, scratch: Path) -> subprocess.Popen[bytes]:
        options = {
            "--work": self._folder,
            "--sources": self._sources,
            "--say-to": said,
            "--memory-bytes": self._memory_bytes,
            "--file-bytes": max(shutil.disk_usage(self._folder).free, MIN_FILE_BYTES),
        }
        return subprocess.Popen(
            [
                *(sys.executable, "-P", *self._program),
                *(str(part) for option in options.items() for part in option),
                *(["--required"] if self._required else []),
            ],
            stdin=subprocess.PIPE,
            pass_fds=(said,),
            env=_environment(scratch, self._folder / "home"),
            process_group=0,
        )

    def _job(
        self, source: Path, config: dict[str, Any], trajectory: Path | None, read_only: bool
    ) -> dict[str, Any]:
        build = current_build()
        return {
            **self._about,
            "traceparent": None if build is None or build.trace is None else build.trace.traceparent,
            "source": str(source.absolute()),
            "trajectory": None if trajectory is None else str(trajectory.absolute()),
            "config": config,
            "share": self._shared is not None,
            "read_only": read_only,
        }

    def _hear(
        self,
        process: subprocess.Popen[bytes],
        heard: int,
        job: dict[str, Any],
        progress: Callable[[str, float], None],
        cancelled: Callable[[], bool],
    ) -> None:
        """Follows the build until it is done.

        Raises:
            FirstfixError: it failed, ended without a word, or took more processes than it may.
        """
        assert process.stdin is not None
        lines, speaker = Lines(heard), Speaker(process.stdin.fileno())
        told = False
        next_look = 0.0
        try:
            speaker.say(job=job)
            while True:
                message = lines.next(LOOK_S)
                if cancelled() and not told:
                    told = True
                    speaker.say(cancel=True)
                if time.monotonic() >= next_look:
                    next_look = time.monotonic() + LOOK_S
                    problem = too_many_processes(process.pid)
                    if problem:
                        raise BuildFailed(f"{problem} in {self._stage}")
                if message is not None and self._take(message, speaker, progress):
                    return
        except (BrokenPipeError, EOFError):
            raise of_exit(process.wait(), self._stage) from None

    def _take(
        self, message: dict[str, Any], speaker: Speaker, progress: Callable[[str, float], None]
    ) -> bool:
        """Whether it was the last message."""
        match message:
            case {"stage": str(stage), "done": float() | int() as done} if stage in STAGES and math.isfinite(
                done
            ):
                self._stage = stage
                progress(stage, done)
            case {"cached": str(stage)} if stage in STAGES:
                mark_cached(stage)
            case {"fetch": str(key)}:
                speaker.say(answer=self._fetch(key))
            case {"share": [str(key), str(name), str(folder)]}:
                speaker.say(answer=self._put(key, name, folder))
            case {"confined": list(missing)}:
                self._check_confined([str(one)[:200] for one in missing])
            case {"built": True}:
                return True
            case {"failed": said}:
                raise as_error(said)
            case _:
                raise BuildFailed("the build said something that is no message")
        return False

    def _check_confined(self, missing: list[str]) -> None:
        if not missing:
            return
        if self._required:
            raise BuildFailed(
                f"the sandbox is not whole on this machine, and it is required: {'; '.join(missing)}"
            )
        _log.warning("the build's sandbox is not whole on this machine: %s", "; ".join(missing))

    def _fetch(self, key: str) -> str:
        """The name of a folder of the build's in which the stage was put; empty: there is none."""
        name = f"fetched-{uuid.uuid4().hex}"  # nobody in the sandbox could put a link there before
        folder = self._taken / name
        folder.mkdir()
        try:
            if self._shared is None or not self._shared.fetch(key, folder):
                return ""
        except FirstfixError as error:  # no key of a stage
            raise BuildFailed(str(error)) from None
        folder.rename(self._folder / name)
        return name

    def _put(self, key: str, name: str, folder: str) -> int:
        if self._shared is None or name not in STAGES:
            raise BuildFailed("the build shared something that is no stage")
        taken = self._taken / uuid.uuid4().hex
        try:
            take_files(self._folder, folder, taken)
            return self._shared.put(key, name, taken)
        finally:
            shutil.rmtree(taken, ignore_errors=True)


def _end(process: subprocess.Popen[bytes]) -> None:
    """All of the build: none of its processes can leave the group."""
    assert process.stdin is not None
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    wait_until_ended(process.pid, END_WITHIN_S)
    with suppress(BrokenPipeError):
        process.stdin.close()


def _environment(scratch: Path, home: Path) -> dict[str, str]:
    passed = {
        name: value
        for name, value in os.environ.items()
        if name in _PASSED or name.startswith(_PASSED_PREFIXES)
    }
    # libraries keep lists there that take seconds to make, such as that of the fonts
    return {**passed, "HOME": str(home), "MPLCONFIGDIR": str(home), "TMPDIR": str(scratch)}
