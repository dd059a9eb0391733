"""Processes of a build session: the sandbox is another process group, measured and killed with the rest."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from firstfix_service.builds.process import kill_processes, memory_of_processes_bytes
from tests.waiting import wait_until

ALLOCATE = "import sys; data = bytearray(b'x') * (100 << 20); print('ready', flush=True); sys.stdin.read()"


@pytest.fixture
def session() -> Iterator[subprocess.Popen[bytes]]:
    """A process that leads a session, and has started one in another group."""
    program = (
        "import subprocess, sys\n"
        f"command = [sys.executable, '-c', {ALLOCATE!r}]\n"
        "child = subprocess.Popen(command, process_group=0, stdin=subprocess.PIPE)\n"
        "sys.stdin.read()\n"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", program],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        start_new_session=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == b"ready\n"
    yield process
    kill_processes(process.pid)
    process.wait()


def test_the_memory_of_all_groups_counts(session: subprocess.Popen[bytes]):
    assert memory_of_processes_bytes(session.pid) > 100 << 20


def test_all_groups_are_ended(session: subprocess.Popen[bytes]):
    kill_processes(session.pid)
    session.wait()
    wait_until(lambda: not alive_in(session.pid))


def alive_in(session: int) -> list[str]:
    found = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = path.read_text().rpartition(")")[2].split()
        except OSError:  # it has ended
            continue
        if int(fields[3]) == session and fields[0] != "Z":
            found.append(path.parent.name)
    return found
