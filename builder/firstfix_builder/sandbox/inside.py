"""The process of a build in the sandbox: it confines itself, receives its job and reports the result.

    python -m firstfix_builder.sandbox.inside --work DIR --sources DIR --messages-to HANDLE ...

The job arrives at standard input. Only the standard library is imported before the process is confined.
"""

from __future__ import annotations

import argparse
import logging
import os
import shutil
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .confine import Limits, confine

if TYPE_CHECKING:
    from .messages import MessageReader, MessageWriter

TICK_S = 0.1
_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Flows:
    """The jobs that a build can do: ``pipeline.build_version`` and ``pipeline.read_source``.

    Attributes:
        get_ready: does what a job would begin with, while there is none.
    """

    build_version: Callable[..., object]
    read_source: Callable[..., object]
    get_ready: Callable[[], None] = lambda: None


def pipeline_flows() -> Flows:
    """Import the real flows, which takes seconds, and note the source code that was imported."""
    from ..execution.source_hash import source_hash
    from ..pipeline import build_version, get_ready, read_source

    source_hash()  # it may be replaced on disk before there is a job
    return Flows(build_version, read_source, get_ready)


def main(flows: Callable[[], Flows] = pipeline_flows) -> int:
    """Confine this process, then wait for the job and run it."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--work", required=True, type=Path)
    parser.add_argument("--sources", required=True, type=Path, action="append")
    for name in ("--messages-to", "--memory-bytes", "--file-bytes"):
        parser.add_argument(name, required=True, type=int)
    parser.add_argument("--required", action="store_true")
    chosen = parser.parse_args()
    os.set_inheritable(chosen.messages_to, False)
    missing = confine(
        read=tuple(chosen.sources),
        write=(chosen.work,),
        limits=Limits(chosen.memory_bytes, chosen.file_bytes),
    )
    os.chdir(chosen.work)

    from .messages import MessageReader, MessageWriter

    writer, reader = MessageWriter(chosen.messages_to), MessageReader(0)
    writer.send(confined=missing)
    if missing and chosen.required:
        return 1
    available = flows()
    message = reader.next(0.0)
    if message is None:
        available.get_ready()
    while message is None:
        message = reader.next(3600.0)
    return run_job(available, message["job"], chosen.work, writer, reader)


class Outside:
    """The worker outside the sandbox: it cancels the build, and fetches and shares finished stages."""

    def __init__(self, writer: MessageWriter, reader: MessageReader, work: Path) -> None:
        self._writer = writer
        self._reader = reader
        self._work = work
        self._asking = threading.Lock()
        self._answered = threading.Event()
        self._answer: Any = None
        self._cancelled = threading.Event()
        self._reported: tuple[str, float] = "", 0.0
        threading.Thread(target=self._listen, daemon=True, name="outside").start()

    def is_cancelled(self) -> bool:
        """Whether the worker has cancelled the build."""
        return self._cancelled.is_set()

    def tick(self, stage: str, fraction: float) -> None:
        """Reports progress, at most once in ``TICK_S``."""
        reported, at = self._reported
        if stage != reported or fraction >= 1.0 or time.monotonic() - at >= TICK_S:
            self._reported = stage, time.monotonic()
            self._writer.send(stage=stage, done=fraction)

    def fetch(self, key: str, folder: Path) -> bool:
        """Fetch a stage through the worker, like ``SharedStages.fetch``."""
        brought = self._ask(fetch=key)
        if not brought:
            return False
        for path in (self._work / brought).iterdir():
            shutil.move(path, folder / path.name)
        (self._work / brought).rmdir()
        return True

    def put(self, key: str, name: str, folder: Path) -> int:
        """Share a stage through the worker, like ``SharedStages.put``."""
        return int(self._ask(share=[key, name, str(folder.resolve().relative_to(self._work.resolve()))]))

    def publish_provisional(self, built: object) -> None:
        """Ask the worker to publish the provisional version, which it finds in the work folder."""
        self._ask(provisional=True)

    def _ask(self, **message: Any) -> Any:
        with self._asking:
            self._answered.clear()
            self._writer.send(**message)
            self._answered.wait()
            return self._answer

    def _listen(self) -> None:
        while True:
            try:
                message = self._reader.next(3600.0)
            except EOFError:
                os._exit(1)  # the worker is gone
            if message is None:
                continue
            if "cancel" in message:
                self._cancelled.set()
            elif "answer" in message:
                self._answer = message["answer"]
                self._answered.set()


def run_job(
    flows: Flows, job: dict[str, Any], work: Path, writer: MessageWriter, reader: MessageReader
) -> int:
    """Run the job and reports how it ended. Returns the exit code."""
    from firstfix.builds.config import BuildConfig
    from firstfix.builds.options import BuildOptions

    from ..execution.build_trace import BuildTrace, set_up_build_log
    from ..job.build_job import error_record

    options = BuildOptions.from_arguments(job["arguments"], job["environment"])
    set_up_build_log(options)
    outside = Outside(writer, reader, work)

    class Trace(BuildTrace):
        """Trace for the log lines. The worker outside makes the spans, because it has the network."""

        def mark_cached(self, stage: str) -> None:
            writer.send(cached=stage)

        def mark_chunks(self, stage: str, count: int, reused: int) -> None:
            writer.send(chunks=[stage, count, reused])

    with Trace(options.build_id, "", options.traceparent, {}) as trace:

        def progress(stage: str, fraction: float) -> None:
            trace.tick(stage)
            outside.tick(stage, fraction)

        more: dict[str, Any] = {}
        if options.provisional:
            more["publish_provisional"] = outside.publish_provisional
        if not job["read_only"]:
            more["base"] = None if job["base"] is None else Path(job["base"])
        try:
            flow = flows.read_source if job["read_only"] else flows.build_version
            flow(
                Path(job["source"]),
                BuildConfig.parse(job["config"]),
                work,
                trajectory=None if job["trajectory"] is None else Path(job["trajectory"]),
                confirmed=None if job["confirmed"] is None else Path(job["confirmed"]),
                progress=progress,
                cancelled=outside.is_cancelled,
                shared=outside if options.share_stages else None,
                options=options,
                **more,
            )
        except Exception as error:
            _log.exception("build %s failed in %s", options.build_id, trace.stage)
            writer.send(failed=error_record(error, work.parent))
            return 1
    writer.send(built=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
