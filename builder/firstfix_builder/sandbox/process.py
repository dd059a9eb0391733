"""The process of a sandboxed build: its options, its environment, its start and its end."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path

from firstfix.builds.options import BuildOptions

# A build has one process for each processor, and in each process a few threads for each processor.
MAX_PROCESSES = 64 + 4 * (os.cpu_count() or 1)
MAX_THREADS = 1024 + 16 * (os.cpu_count() or 1) ** 2


def too_many_processes(group: int) -> str:
    """A message about the limit that the group exceeds; empty if it exceeds none."""
    processes = threads = 0
    for count in _threads(group):
        processes += 1
        threads += count
    if processes > MAX_PROCESSES:
        return f"the build started more than {MAX_PROCESSES} processes"
    if threads > MAX_THREADS:
        return f"the build started more than {MAX_THREADS} threads"
    return ""


def wait_until_ended(group: int, timeout_s: float) -> None:
    """Wait until no process of the group runs; all of them were killed."""
    end = time.monotonic() + timeout_s
    while any(_threads(group)) and time.monotonic() < end:
        time.sleep(0.01)


def _threads(group: int) -> Iterator[int]:
    """Yield the number of threads of each running process of the group."""
    for folder in Path("/proc").iterdir():
        if folder.name.isdigit():
            try:
                # After the name, which may hold anything: state, parent, group, and the threads as the 18th.
                fields = (folder / "stat").read_bytes().rpartition(b")")[2].split()
            except OSError:  # ended meanwhile
                continue
            if int(fields[2]) == group and fields[0] not in (b"Z", b"X"):
                yield int(fields[17])


END_WITHIN_S = 20.0  # of a process that was killed
PROGRAM = ("-m", "firstfix_builder.sandbox.inside")
MIN_FILE_BYTES = 1 << 30
MIN_MEMORY_BYTES = 4 << 30  # that libraries reserve for threads and heaps
# The environment variables that a build gets: how to find Python and its libraries.
_PASSED = ("PATH", "LANG", "LC_ALL", "TZ", "PYTHONPATH", "PYTHONUNBUFFERED", "PYTHONDONTWRITEBYTECODE")
_PASSED_PREFIXES = ("OMP_", "OPENBLAS_", "MKL_", "LD_LIBRARY_")


def start_process(
    options: BuildOptions,
    sources: Sequence[Path],
    scratch: Path,
    messages_to: int,
    *,
    program: Sequence[str] = PROGRAM,
    reading: bool = False,
) -> subprocess.Popen[bytes]:
    """Start the inner side. It reads messages from its standard input.

    Args:
        options: of the build process; the sandbox may write to ``<work>/build``.
        sources: files and folders that may be read.
        scratch: for temporary files.
        messages_to: handle that it writes messages to.
        program: as arguments of the Python interpreter.
        reading: it reads the source and nothing else.
    """
    folder = options.work / "build"
    arguments = {
        "--work": folder,
        "--messages-to": messages_to,
        "--memory-bytes": reserved_bytes(options.max_memory_bytes, reading=reading),
        "--file-bytes": max(shutil.disk_usage(folder).free, MIN_FILE_BYTES),
    }
    return subprocess.Popen(
        [
            *(sys.executable, "-P", *program),
            *(str(part) for argument in arguments.items() for part in argument),
            *(part for source in sources for part in ("--sources", str(source))),
            *(["--required"] if options.sandbox == "required" else []),
        ],
        stdin=subprocess.PIPE,
        pass_fds=(messages_to,),
        env=_environment(scratch),
        process_group=0,
    )


def reserved_bytes(max_memory_bytes: int | None, *, reading: bool) -> int:
    """The memory that one process may reserve, used or not.

    Args:
        max_memory_bytes: of all processes of the build together, which the service enforces; None: all memory
            of the machine.
        reading: it reads the source and nothing else: one process, which uses what it reserves.
    """
    all_bytes = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    return max((1 if reading else 2) * (max_memory_bytes or all_bytes), MIN_MEMORY_BYTES)


def end_process(process: subprocess.Popen[bytes]) -> None:
    """Kill a build and all processes that it started: none of them can leave its group."""
    assert process.stdin is not None
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    wait_until_ended(process.pid, END_WITHIN_S)
    with suppress(BrokenPipeError):
        process.stdin.close()


def _environment(scratch: Path) -> dict[str, str]:
    passed = {
        name: value
        for name, value in os.environ.items()
        if name in _PASSED or name.startswith(_PASSED_PREFIXES)
    }
    return {**passed, "HOME": str(scratch), "TMPDIR": str(scratch)}  # no build finds what another left there
