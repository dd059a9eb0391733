"""Process of a build: its options, its end, and all processes that it starts."""

from __future__ import annotations

import asyncio
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from pydantic import ValidationError

from firstfix.builds.limits import memory_bytes
from firstfix_service.builds.process import (
    BuildProcess,
    build_options,
    kill_processes,
    memory_of_processes_bytes,
)
from firstfix_service.settings import Settings
from tests.waiting import wait_until


class Ending:
    """A process that ends when the test says so."""

    pid = 0

    def __init__(self) -> None:
        self.code: asyncio.Future[int] = asyncio.get_running_loop().create_future()

    async def wait(self) -> int:
        return await self.code


@pytest.mark.parametrize("turns", range(5))
def test_a_wait_for_the_process_can_be_cancelled_just_when_it_ends(tmp_path: Path, turns: int):
    async def main() -> None:
        ending = Ending()
        process = BuildProcess(ending, tmp_path / "log", None)  # type: ignore[arg-type]
        waiting = asyncio.create_task(process.wait(60.0))
        await asyncio.sleep(0.1)
        ending.code.set_result(0)
        for _ in range(turns):  # of the event loop, in which the end arrives
            await asyncio.sleep(0)
        if waiting.cancel():  # otherwise the end had arrived before
            with pytest.raises(asyncio.CancelledError):
                await waiting

    asyncio.run(main())


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


def test_the_memory_of_all_process_groups_counts(session: subprocess.Popen[bytes]):
    assert memory_of_processes_bytes(session.pid) > 100 << 20


def test_all_process_groups_are_killed(session: subprocess.Popen[bytes]):
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


def test_a_build_gets_the_address_of_the_cluster():
    here = Settings(store="s3://maps")
    there = Settings(store="s3://maps", build_executor="dask://scheduler:8786")
    assert "--executor" not in build_options(here).arguments()
    assert build_options(there).scheduler == "tcp://scheduler:8786"


def test_stages_are_shared_with_a_cluster():
    assert not build_options(Settings(store="s3://maps")).share_stages
    clustered = {"build_executor": "dask+tls://scheduler:8786", "shared_stages_max_bytes": 0}
    assert build_options(Settings(store="s3://maps", **clustered)).share_stages


@pytest.mark.parametrize(
    "executor",
    ["dask", "dask://", "dask://host", "tcp://host:8786", "dask://me@host:8786", "dask://h:8786/x"],
)
def test_an_invalid_executor_is_refused(executor: str):
    with pytest.raises(ValidationError, match="build_executor"):
        Settings(store="s3://maps", build_executor=executor)


def test_a_build_gets_its_sandbox_and_its_memory_limit():
    plain = build_options(Settings(store="memory://")).environment()
    assert plain["FIRSTFIX_BUILD_SANDBOX"] == "auto"
    assert plain["FIRSTFIX_BUILD_MAX_MEMORY_BYTES"] == str(memory_bytes() // 2)
    assert plain["FIRSTFIX_BUILD_MAX_TEMPLATES"] == "4000000"
    limited = Settings(store="memory://", build_sandbox="required", build_max_memory_bytes=1 << 30)
    told = build_options(limited).environment()
    assert told["FIRSTFIX_BUILD_SANDBOX"] == "required"
    assert told["FIRSTFIX_BUILD_MAX_MEMORY_BYTES"] == str(1 << 30)
    unlimited = build_options(Settings(store="memory://", build_max_memory_bytes=0))
    assert unlimited.max_memory_bytes is None
    assert unlimited.environment()["FIRSTFIX_BUILD_MAX_MEMORY_BYTES"] == "0"
