"""Watchdog of the parts of this process that must go on: the event loop, and the threads of zenoh.

A thread of its own asks each part for a sign of life. It logs the stacks of all threads when a part does not
come back, and ends the process after a longer time, so that whoever started it starts it anew.

Time in which the process itself did not run does not count: it was stopped by a signal, the machine slept, or
it had no processor. The gap between two ticks of the watchdog's own thread shows this, together with the
processor time that the process took in the gap. That time tells such a stop from a long call that holds the
interpreter's lock.
"""

from __future__ import annotations

import asyncio
import itertools
import os
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import NoReturn

import structlog

from .histogram import Histogram
from .log_setup import LAST_LINES_WITHIN_S, drain_log

_log = structlog.get_logger(__name__)
EXIT_STALLED = 70  # EX_SOFTWARE: exit code of a process that ended itself because a part stood still
TICK_S = 0.1
STACKS_AFTER_S = 1.0
UNWELL_AFTER_S = 5.0  # of a stall, for /healthz
UNWELL_FOR_S = 20.0  # after the end of such a stall
MAX_FRAMES = 25  # of one thread's stack, the innermost
MAX_STACKS_CHARS = 24_000


def end_process(event: str, part: str) -> NoReturn:
    """Logs why, with the stacks of all threads, and ends the process at once with ``EXIT_STALLED``."""
    _log.critical(event, part=part, stacks=stacks_of_all_threads(), exit_code=EXIT_STALLED)
    drain_log(LAST_LINES_WITHIN_S)
    os._exit(EXIT_STALLED)


class Pulse:
    """Sign of life of one part: what it does now began at a time, and must end. Thread-safe.

    Args:
        name: of the part, for people.
        is_vital: nothing is answered without it, so the process is ended at once and not stopped in order.
    """

    def __init__(self, name: str, *, is_vital: bool = False) -> None:
        self.name = name
        self.is_vital = is_vital
        self.stalled_s = 0.0  # of the call that is under way
        self._is_under_way = False
        self._is_logged = False
        self._last_stall_s, self._last_end = 0.0, 0.0
        self._lock = threading.Lock()

    @contextmanager
    def call(self) -> Iterator[None]:
        """Mark a call that must come back."""
        self.begin()
        try:
            yield
        finally:
            self.end()

    @property
    def is_under_way(self) -> bool:
        """True between ``begin`` and ``end``."""
        return self._is_under_way

    def begin(self) -> None:
        """Mark the begin of a call."""
        with self._lock:
            self._is_under_way, self.stalled_s, self._is_logged = True, 0.0, False

    def end(self) -> None:
        """Mark the end of the call."""
        with self._lock:
            self._is_under_way = False
            if self._is_logged:
                self._last_stall_s, self._last_end = self.stalled_s, time.monotonic()
                _log.warning("a part goes on", part=self.name, stood_still_s=round(self.stalled_s, 1))

    def pass_time(self, seconds: float) -> bool:
        """Counts time of the call under way. Returns whether its stacks are to be logged: once a call."""
        with self._lock:
            if not self._is_under_way:
                return False
            self.stalled_s += seconds
            if self._is_logged or self.stalled_s < STACKS_AFTER_S:
                return False
            self._is_logged = True
            return True

    def why_unwell(self) -> str | None:
        """Fault of the part, or None."""
        with self._lock:
            if self._is_under_way and self.stalled_s >= UNWELL_AFTER_S:
                return f"{self.name} has not come back for {self.stalled_s:.0f} s"
            ago_s = time.monotonic() - self._last_end
            if self._last_stall_s >= UNWELL_AFTER_S and ago_s < UNWELL_FOR_S:
                return f"{self.name} stood still for {self._last_stall_s:.0f} s, {ago_s:.0f} s ago"
            return None


class StallWatch:
    """Watches one event loop, and the parts that ``add`` names, while it runs.

    Attributes:
        on_stall: called once, by the watchdog's thread, with the part that stood still for too long.

    Args:
        lag: gets the time that the event loop takes to come to a call.
        limit_s: time after which ``on_stall`` is called; 0: never.
    """

    def __init__(self, lag: Histogram, limit_s: float) -> None:
        self.on_stall: Callable[[Pulse], None] = lambda pulse: None
        self._lag = lag
        self._limit_s = limit_s
        self._loop_pulse = Pulse("the event loop", is_vital=True)
        self._pulses = [self._loop_pulse]
        self._asked_at = 0.0
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None

    def add(self, name: str) -> Pulse:
        """The pulse of one more part."""
        pulse = Pulse(name)
        self._pulses.append(pulse)
        return pulse

    def why_unwell(self) -> str | None:
        """Part that stands still, or stood still for long a moment ago; None: none."""
        return next((why for pulse in self._pulses if (why := pulse.why_unwell()) is not None), None)

    def start(self, loop: asyncio.AbstractEventLoop) -> None:
        """Begin to watch. Call it when the service has started: a start may take its time."""
        self._thread = threading.Thread(target=self._run, args=(loop,), name="stall-watch", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the watch."""
        self._stop.set()
        if self._thread is not None:
            self._thread.join()

    def _run(self, loop: asyncio.AbstractEventLoop) -> None:
        tick, used = time.monotonic(), time.process_time()
        while not self._stop.wait(TICK_S):
            tick_before, used_before = tick, used
            tick, used = time.monotonic(), time.process_time()
            passed_s = min(tick - tick_before, 2 * TICK_S + used - used_before)
            for pulse in self._pulses:
                if pulse.pass_time(passed_s):
                    self._report(pulse)
                if self._limit_s and pulse.is_under_way and pulse.stalled_s >= self._limit_s:
                    self.on_stall(pulse)
                    return
            if not self._loop_pulse.is_under_way:
                self._loop_pulse.begin()
                self._asked_at = time.monotonic()
                try:
                    loop.call_soon_threadsafe(self._loop_answers)
                except RuntimeError:  # the loop has ended
                    return

    def _loop_answers(self) -> None:
        lag_s = min(time.monotonic() - self._asked_at, self._loop_pulse.stalled_s + 3 * TICK_S)
        self._loop_pulse.end()
        self._lag.observe(lag_s)

    def _report(self, pulse: Pulse) -> None:
        _log.error(
            "a part stands still",
            part=pulse.name,
            for_s=round(pulse.stalled_s, 1),
            ends_process_after_s=self._limit_s or None,
            stacks=stacks_of_all_threads(),
        )


def stacks_of_all_threads() -> str:
    """The stacks without variables, which could contain secrets, innermost frame last.

    Threads that stand at the same place share one stack.
    """
    names = {thread.ident: thread.name for thread in threading.enumerate()}
    main = threading.main_thread().ident
    found: dict[str, list[str]] = {}
    frames = sys._current_frames()
    for ident in sorted(frames, key=lambda one: (one != main, names.get(one, ""))):
        found.setdefault(_text(frames[ident]), []).append(names.get(ident, f"thread {ident}"))
    whole = "\n".join(f"{', '.join(threads)}:\n{text}" for text, threads in found.items())
    return whole if len(whole) <= MAX_STACKS_CHARS else f"{whole[:MAX_STACKS_CHARS]}\n..."


def _text(frame: FrameType) -> str:
    """Read no source file: its disk may be what hangs."""
    inner = itertools.islice(traceback.walk_stack(frame), MAX_FRAMES)
    lines = [f"  {one.f_code.co_filename}:{line} {one.f_code.co_name}" for one, line in inner]
    return "\n".join(reversed(lines))
