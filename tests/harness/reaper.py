"""Runs a command, and ends with it each process that it left behind, however deep, detached or orphaned.

    python tests/harness/reaper.py [--limit-s SECONDS] COMMAND [ARGUMENT ...]

`make test` runs pytest under it with a limit, and pytest each xdist worker (``dead_workers``). The kernel
makes the reaper the parent of all orphans below it (a subreaper), so a command that is killed leaves
nothing behind. It dies with its own parent, and the command dies with it.
"""

from __future__ import annotations

import argparse
import ctypes
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from types import FrameType

import psutil

GRACE_S = 60  # between the request to end and the kill: workers print their stacks, pytest its summary
_PATIENCE_S = 2.0  # with what ends by itself once the command has ended
_VAIN_S = 30.0  # a process that cannot be killed waits in the kernel, maybe for ever
_SET_PDEATHSIG, _SET_CHILD_SUBREAPER = 1, 36
_libc = ctypes.CDLL(None, use_errno=True)


def _prctl(option: int, value: int) -> None:
    if _libc.prctl(option, value, 0, 0, 0) != 0:
        raise OSError(ctypes.get_errno(), "prctl")


def _die_with(parent: int, number: signal.Signals) -> Callable[[], None]:
    def ask() -> None:
        _prctl(_SET_PDEATHSIG, number)
        if os.getppid() != parent:  # it has ended meanwhile
            os.kill(os.getpid(), number)

    return ask


def run(command: list[str], limit_s: int | None = None) -> int:
    """Runs the command to its end, or to the limit; returns its exit status as a shell would.

    At the limit the command is sent SIGTERM, and SIGKILL after ``GRACE_S``. SIGTERM and SIGHUP to the
    reaper do the same.
    """
    _prctl(_SET_CHILD_SUBREAPER, 1)
    process = subprocess.Popen(command, preexec_fn=_die_with(os.getpid(), signal.SIGKILL))
    asked_to_end = False

    def end(number: int, frame: FrameType | None) -> None:
        nonlocal asked_to_end
        if number == signal.SIGALRM and not asked_to_end:
            _say(f"the limit of {limit_s} s is reached")
        process.send_signal(signal.SIGKILL if asked_to_end else signal.SIGTERM)
        asked_to_end = True
        signal.alarm(GRACE_S)

    for number in (signal.SIGTERM, signal.SIGHUP, signal.SIGALRM):
        signal.signal(number, end)
    # The terminal interrupts the command as well. SIG_IGN would be the command's too.
    signal.signal(signal.SIGINT, lambda *_: None)
    signal.signal(signal.SIGUSR2, lambda *_: process.send_signal(signal.SIGUSR2))
    if limit_s is not None:
        signal.alarm(limit_s)
    _let_go_of_the_pipes()

    while process.returncode is None:
        pid, status = os.wait()  # of orphans too, which nobody else would bury
        if pid == process.pid:
            process.returncode = os.waitstatus_to_exitcode(status)
    signal.alarm(0)
    _end_what_is_left(patience_s=_PATIENCE_S if process.returncode >= 0 else 0)
    return process.returncode if process.returncode >= 0 else 128 - process.returncode


def _let_go_of_the_pipes() -> None:
    """Leaves them to the command: who reads from it waits for its end, not for the reaper's."""
    nothing = os.open(os.devnull, os.O_RDWR)
    for descriptor in (0, 1):
        os.dup2(nothing, descriptor)


def _end_what_is_left(patience_s: float) -> None:
    told = set()
    kill_at = time.monotonic() + patience_s
    while (left := psutil.Process().children(recursive=True)) and time.monotonic() < kill_at + _VAIN_S:
        for one in left if time.monotonic() >= kill_at else ():
            with suppress(psutil.NoSuchProcess):
                if one.pid not in told and one.status() != psutil.STATUS_ZOMBIE:
                    _say(f"kills {one.pid}, left behind: {' '.join(one.cmdline())[:200] or one.name()}")
                told.add(one.pid)
                one.kill()
        with suppress(ChildProcessError):
            while os.waitpid(-1, os.WNOHANG)[0]:
                pass
        time.sleep(0.02)


def _say(text: str) -> None:
    print(f"reaper: {text}", file=sys.stderr, flush=True)


def main() -> int:
    """Reads the command line and runs the command."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--limit-s", type=int)
    parser.add_argument("command", nargs=argparse.REMAINDER)
    asked = parser.parse_args()
    _die_with(os.getppid(), signal.SIGTERM)()
    return run(asked.command, asked.limit_s)


if __name__ == "__main__":
    sys.exit(main())
