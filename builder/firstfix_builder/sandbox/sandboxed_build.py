"""The worker's side of a sandboxed build: sends it the job, follows its messages, and takes its files over.

<work>/sources/    files that the build reads
<work>/build/      files that the build writes: stages, chunks, the version
<work>/taken/      files that this side took over, or is about to hand in; the build has no access
"""

from __future__ import annotations

import logging
import math
import shutil
import signal
import subprocess
import time
import uuid
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from firstfix.builds.options import PROVISIONAL, STAGES, BuildOptions
from firstfix.builds.shared_stages import SharedStages
from firstfix.catalog.manifest import FILE_NAME, MAX_BYTES, Manifest
from firstfix.errors import (
    BuildCancelled,
    BuildFailed,
    CorruptVersion,
    FirstfixError,
    InputError,
    NotFound,
    OutOfSpace,
)
from firstfix.store.store import Store

from ..execution.build_trace import current_build, mark_cached, mark_chunks
from ..job.build_job import BuildJob, BuildResult
from .hand_over import take_files
from .messages import MessageReader, MessageWriter
from .prepared import PreparedSandbox
from .process import PROGRAM, too_many_processes

_log = logging.getLogger(__name__)
LOOK_S = 0.2
_OTHER_KINDS: tuple[type[FirstfixError], ...] = (NotFound, BuildCancelled, OutOfSpace)


class SandboxedBuild:
    """One build in a sandbox. No other build may use the folder at the same time.

    Args:
        options: of the build process. The sandbox gets ``BuildOptions.inside``.
        sources: files and folders that the build reads; None: ``<work>/sources``.
        program: the inner side, as arguments of the Python interpreter.
    """

    def __init__(
        self,
        options: BuildOptions,
        *,
        sources: Sequence[Path] | None = None,
        program: Sequence[str] = PROGRAM,
    ) -> None:
        self._options = replace(options, work=options.work.absolute())
        self._work = self._options.work
        self._folder = self._work / "build"
        self._sources = [self._work / "sources"] if sources is None else [one.resolve() for one in sources]
        self._taken = self._work / "taken"
        self._program = program
        self._prepared: PreparedSandbox | None = None
        self._shared = SharedStages(Store.open(options.store)) if options.share_stages else None
        self._stage = STAGES[0]

    @property
    def build_id(self) -> str:
        """Id of the build, which may be told after the sandbox is prepared."""
        return self._options.build_id

    @build_id.setter
    def build_id(self, build_id: str) -> None:
        self._options = replace(self._options, build_id=build_id)

    def prepare(self) -> None:
        """Start the sandbox of the next ``build_version``: it imports its libraries until there is a job."""
        with suppress(OSError):  # the build will try again, and say why
            self._prepared = self._started(read_only=False)

    def close(self) -> None:
        """End a sandbox that was prepared and not used."""
        if self._prepared is not None:
            self._prepared.end()
            self._prepared = None

    def build_version(self, job: BuildJob) -> BuildResult:
        """Build a version as ``pipeline.build_version`` does, from files below ``<work>/sources``.

        Raises:
            InputError: the source cannot be read.
            BuildFailed: a stage could not do its work, or the sandbox ended it.
            BuildCancelled: cancelled() said so.
        """
        self._run(job, read_only=False)
        return self._take_version("version")

    def _take_version(self, name: str) -> BuildResult:
        """Take a version over from a folder of the build.

        Raises:
            BuildFailed: there is none, or it differs from its manifest.
        """
        taken = self._taken / name
        take_files(self._folder, name, taken)
        record = taken / FILE_NAME
        if not record.is_file() or record.stat().st_size > MAX_BYTES:
            raise BuildFailed("the build made no version")
        try:
            manifest = Manifest.from_json(record.read_bytes())
            manifest.verify_directory(taken)
        except CorruptVersion as error:
            raise BuildFailed(f"the build made no version: {error}") from None
        return BuildResult(taken, manifest)

    def read_source(self, job: BuildJob) -> None:
        """Run the first stage alone, which parses files of unknown origin.

        The result is in the stage cache of ``<work>/build``. Raises as ``build_version`` does.
        """
        self._run(job, read_only=True)

    def _run(self, job: BuildJob, *, read_only: bool) -> None:
        shutil.rmtree(self._taken, ignore_errors=True)
        for left in self._folder.glob("fetched-*"):
            shutil.rmtree(left, ignore_errors=True)
        self._taken.mkdir(parents=True, exist_ok=True)
        sandbox = self._begun(read_only)
        try:
            for other in sandbox.scratch.parent.iterdir():  # of sandboxes that were killed
                if other != sandbox.scratch:
                    shutil.rmtree(other, ignore_errors=True)
            self._follow(sandbox.process, sandbox.messages, job, self._message(job, read_only))
        finally:
            sandbox.end()

    def _begun(self, read_only: bool) -> PreparedSandbox:
        """The sandbox that was prepared, or a new one."""
        prepared, self._prepared = self._prepared, None
        if prepared is not None:
            if prepared.is_usable and not read_only:
                return prepared
            prepared.end()
        return self._started(read_only=read_only)

    def _started(self, *, read_only: bool) -> PreparedSandbox:
        return PreparedSandbox.start(self._options, self._sources, program=self._program, reading=read_only)

    def _message(self, job: BuildJob, read_only: bool) -> dict[str, Any]:
        """The job as the inner side reads it."""
        build = current_build()
        options = self._options.inside(
            provisional=not read_only and job.publish_provisional is not None,
            traceparent=None if build is None or build.trace is None else build.trace.traceparent,
        )
        return {
            "arguments": options.arguments(),
            "environment": options.environment(),
            "source": str(job.source.absolute()),
            "trajectory": None if job.trajectory is None else str(job.trajectory.absolute()),
            "confirmed": None if job.confirmed is None else str(job.confirmed.absolute()),
            "base": None if job.base is None else str(job.base.absolute()),
            "config": job.config,
            "read_only": read_only,
        }

    def _follow(
        self, process: subprocess.Popen[bytes], read_end: int, job: BuildJob, task: dict[str, Any]
    ) -> None:
        """Follow the build until it is done.

        Raises:
            FirstfixError: it failed, ended without a message, or started more processes than it may.
        """
        assert process.stdin is not None
        reader, writer = MessageReader(read_end), MessageWriter(process.stdin.fileno())
        is_cancelled = False
        next_look = 0.0
        try:
            writer.send(job=task)
            while True:
                message = reader.next(LOOK_S)
                if job.cancelled() and not is_cancelled:
                    is_cancelled = True
                    writer.send(cancel=True)
                if time.monotonic() >= next_look:
                    next_look = time.monotonic() + LOOK_S
                    problem = too_many_processes(process.pid)
                    if problem:
                        raise BuildFailed(f"{problem} in {self._stage}")
                if message is not None and self._handle_message(message, writer, job):
                    return
        except (BrokenPipeError, EOFError):
            raise _of_exit(process.wait(), self._stage) from None

    def _handle_message(self, message: dict[str, Any], writer: MessageWriter, job: BuildJob) -> bool:
        """Handle one message. Returns whether it was the last."""
        match message:
            case {"stage": str(stage), "done": float() | int() as done} if stage in (
                *STAGES,
                PROVISIONAL,
            ) and math.isfinite(done):
                self._stage = stage
                job.progress(stage, done)
            case {"provisional": True} if job.publish_provisional is not None:
                built = self._take_version("provisional")
                if not built.manifest.provisional:
                    raise BuildFailed("the build sent a full version as a provisional one")
                job.publish_provisional(built)
                writer.send(answer=True)
            case {"cached": str(stage)} if stage in STAGES:
                mark_cached(stage)
            case {"chunks": [str(stage), int(count), int(reused)]} if (
                stage in STAGES and 0 <= reused <= count
            ):
                mark_chunks(stage, count, reused)
            case {"fetch": str(key)}:
                writer.send(answer=self._fetch(key))
            case {"share": [str(key), str(name), str(folder)]}:
                writer.send(answer=self._put(key, name, folder))
            case {"confined": list(missing)}:
                self._check_confined([str(one)[:200] for one in missing])
            case {"built": True}:
                return True
            case {"failed": report}:
                raise _as_error(report)
            case _:
                raise BuildFailed("the build sent a message of no known form")
        return False

    def _check_confined(self, missing: list[str]) -> None:
        if not missing:
            return
        if self._options.sandbox == "required":
            raise BuildFailed(
                f"the sandbox is required, and incomplete on this machine: {'; '.join(missing)}"
            )
        _log.warning("the build's sandbox is incomplete on this machine: %s", "; ".join(missing))

    def _fetch(self, key: str) -> str:
        """Name of the build's folder into which the stage was put; empty if there is no such stage."""
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
            raise BuildFailed("the build shared a stage of no known name")
        taken = self._taken / uuid.uuid4().hex
        try:
            take_files(self._folder, folder, taken)
            return self._shared.put(key, name, taken)
        finally:
            shutil.rmtree(taken, ignore_errors=True)


def _as_error(report: Any) -> FirstfixError:
    """The error that a sandboxed build reported.

    A build cannot ask to be run again, but for a few times because its disk is full.
    """
    if not isinstance(report, dict):
        return BuildFailed("the build failed and gave no reason")
    code, detail = str(report.get("code")), str(report.get("detail"))[:1000]
    if code == FirstfixError.code:
        return FirstfixError(detail)  # a fault of the program itself: the log has it
    kinds: list[type[FirstfixError]] = [InputError, *InputError.__subclasses__(), *_OTHER_KINDS]
    return next((kind for kind in kinds if kind.code == code), BuildFailed)(detail)


def _of_exit(code: int, stage: str) -> BuildFailed:
    """The error of a build whose process ended without a report."""
    if code < 0:
        return BuildFailed(f"the build's process was ended by {signal.Signals(-code).name} in {stage}")
    return BuildFailed(f"the build's process ended with exit code {code} in {stage}")
