"""Reports a running build's progress to the store, and stops the build when it is cancelled.

One thread writes the status at most twice a second, with the stages that have ended, and checks once a second
for a cancellation. It also receives the signals that stop the process, and notices that the parent has ended.
It does so even while the main thread is in a long native call, during which Python runs no signal handlers.
"""

from __future__ import annotations

import logging
import math
import multiprocessing
import os
import select
import signal
import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from functools import partial
from types import FrameType
from typing import Any

from firstfix.builds.options import BuildOptions, ExitCode
from firstfix.builds.records import FINAL_STATES, new_status
from firstfix.catalog.catalog import Catalog
from firstfix.errors import StoreError
from firstfix.maintenance.build_end import end_build

from ..execution.build_trace import BuildTrace

_log = logging.getLogger(__name__)
STATUS_PERIOD_S = 0.5
CANCEL_PERIOD_S = 1.0
CANCEL_GRACE_S = 10.0  # for the stages to notice; then the process ends
LAST_WORD_S = 3.0  # to write the last status when the process has to end


class BuildReporter:
    """Reports one build, as a context manager.

    ``tick`` and ``is_cancelled`` are cheap and may be called by any thread.

    Attributes:
        provisional_version: digest of the provisional version that the build has published, or None; it is
            part of every status.

    Args:
        options: with ``tied_to_stdin`` the end of standard input has the effect of SIGTERM: the parent was
            killed, and another process will run the build.
        stages: all stages of the build in order, for the overall progress.
        trace: of this run, whose stages are recorded as they end.
        own_process: SIGTERM and SIGINT set the status to queued and end the process with
            ``ExitCode.TRY_AGAIN``; a cancellation that the stages ignore ends it, too. Only for the main
            thread of a process that runs nothing else.
    """

    def __init__(
        self,
        catalog: Catalog,
        options: BuildOptions,
        map_id: str,
        stages: Sequence[str],
        trace: BuildTrace,
        *,
        own_process: bool = False,
    ) -> None:
        build_id = options.build_id
        status = catalog.builds.status_or_queued(build_id)
        self.provisional_version: str | None = status["provisional_version"]
        self._catalog = catalog
        self._build_id = build_id
        self._map_id = map_id
        self._stages = {name: i for i, name in enumerate(stages)}
        self._trace = trace
        self._stages_recorded = -1  # those of an attempt before are on record until this one begins
        self._own_process = own_process
        self._stage = stages[0]
        self._progress = 0.0
        self._written: tuple[str, float, str | None] | None = None
        self._cancelled = threading.Event()
        self._ended = False
        self._wake_read, self._wake_write = os.pipe()
        self._heard_from = [self._wake_read, *([0] if options.tied_to_stdin else [])]
        os.set_blocking(self._wake_write, False)
        self._thread = threading.Thread(target=self._watch, daemon=True, name="build-reporter")

    def __enter__(self) -> BuildReporter:
        self._write_status()
        if self._own_process:
            for number in (signal.SIGTERM, signal.SIGINT):
                signal.signal(number, _heard)
            signal.set_wakeup_fd(self._wake_write, warn_on_full_buffer=False)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()
        if self._own_process:
            # From here on the signals do nothing: the caller records how the build ended, and exits.
            signal.set_wakeup_fd(-1)
        os.close(self._wake_read)
        os.close(self._wake_write)

    def stop(self) -> None:
        """Write no further status. So what the caller writes afterwards stays."""
        self._ended = True
        os.write(self._wake_write, b"\0")
        self._thread.join()

    def tick(self, stage: str, fraction: float) -> None:
        """Note the completed share of a stage, 0..1."""
        if stage in self._stages:
            overall = (self._stages[stage] + min(max(fraction, 0.0), 1.0)) / len(self._stages)
            self._progress = max(self._progress, overall)  # progress never goes back
        self._stage = stage

    @property
    def stage(self) -> str:
        """Name of the current stage."""
        return self._stage

    def waiting_status(self, error: Mapping[str, str]) -> dict[str, Any]:
        """The status of the build while it waits to be run again, and why it has to."""
        return {**self._status("queued"), "error": dict(error)}

    def is_cancelled(self) -> bool:
        """Whether the build is cancelled."""
        return self._cancelled.is_set()

    def _watch(self) -> None:
        next_look, forced_at = time.monotonic(), math.inf
        while True:
            readable, _, _ = select.select(self._heard_from, [], [], STATUS_PERIOD_S)
            # A signal's number, while the end of the context is a zero; or standard input has ended.
            stopped = self._wake_read in readable and any(os.read(self._wake_read, 64))
            if stopped or (0 in readable and not os.read(0, 64)):
                # Every stage and the publish bear a kill at any moment: nothing is wound up.
                self._end_process("queued", ExitCode.TRY_AGAIN)
            if self._ended:
                return
            now = time.monotonic()
            try:
                self._write_status()
                if now >= next_look and not self._cancelled.is_set():
                    next_look = now + CANCEL_PERIOD_S
                    if self._catalog.builds.is_cancel_requested(self._build_id):
                        self._cancelled.set()
                        forced_at = now + CANCEL_GRACE_S
            except StoreError as error:
                _log.warning("build %s: the store did not take or give the status: %s", self._build_id, error)
            if self._own_process and now >= forced_at:
                self._end_process("cancelled", ExitCode.CANCELLED)

    def _write_status(self) -> None:
        ended = list(self._trace.stages)  # before the status, which tells who follows it to look for them
        if len(ended) != self._stages_recorded:
            self._catalog.builds.set_stages(self._build_id, [asdict(stage) for stage in ended])
            self._stages_recorded = len(ended)
        current = (self._stage, self._progress, self.provisional_version)
        if current == self._written:
            return
        status = self._status("running")
        self._catalog.builds.set_status(self._build_id, status)
        self._written = current

    def _status(self, state: str) -> dict[str, Any]:
        return new_status(
            state,
            map_id=self._map_id,
            stage=self._stage,
            progress=self._progress,
            provisional_version=self.provisional_version,
        )

    def _end_process(self, state: str, code: ExitCode) -> None:
        status = self._status(state)
        has_ended = state in FINAL_STATES
        record = partial(end_build, self._catalog) if has_ended else self._catalog.builds.set_status
        last_word = threading.Thread(target=record, args=(self._build_id, status), daemon=True)
        last_word.start()
        last_word.join(LAST_WORD_S)
        for child in multiprocessing.active_children():
            child.kill()
        os._exit(code)


def _heard(number: int, frame: FrameType | None) -> None:
    """Do nothing: the thread at the wake-up pipe receives the signal. Python calls this late or never."""
