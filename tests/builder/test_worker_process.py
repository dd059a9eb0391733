"""The worker as a process that is stopped and killed, with a tiny pipeline of cached stages."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from firstfix.catalog.catalog import Catalog
from firstfix.store.store import Store
from tests.builder.fixtures import queue_build
from tests.waiting import LIMIT_S, let_pass, wait_until

pytestmark = pytest.mark.slow

# One stage that is done soon and one that hangs until a file appears; a pool beside them.
PROGRAM = """
import hashlib, os, sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from firstfix.catalog.manifest import Manifest
from firstfix.builds.options import BuildOptions
from firstfix_builder.execution.local_executor import die_with_parent
from firstfix_builder.execution.stage_cache import StageCache
from firstfix_builder.job import reporter
from firstfix_builder.job.build_job import BuildResult
from firstfix_builder.job.run_build import run_build

def nap():
    # half a minute of native code: no Python signal handler runs before it returns
    hashlib.pbkdf2_hmac("sha256", b"", b"", 100_000_000)

def build_version(job):
    work = job.work
    def first(out):
        with (work / "made").open("a") as file:
            file.write("first\\n")
        (out / "a.bin").write_bytes(job.source.read_bytes())
    def second(out):
        (out / "b.bin").write_bytes(b"b")
        (work / "hangs").write_text("")
        while not (work / "go").exists():
            pool.submit(nap).result() if job.config["in_pool"] else nap()
    with ProcessPoolExecutor(1, mp_context=get_context("spawn"), initializer=die_with_parent) as pool:
        (work / "pool.pid").write_text(str(pool.submit(os.getpid).result()))
        cache = StageCache(work, code_version="1")
        job.progress("one", 0.0)
        cache.run("first", {}, {}, first)
        job.progress("two", 0.0)
        result = cache.run("second", {}, {}, second)
        return BuildResult(result.directory, Manifest.for_directory(result.directory))

if __name__ == "__main__":
    reporter.CANCEL_GRACE_S = 0.5
    url, work, *tied = sys.argv[1:]
    options = BuildOptions(store=url, build_id="b1", work=Path(work), tied_to_stdin=tied == ["tied"])
    raise SystemExit(run_build(options, build_version, ("one", "two"), own_process=True))
"""


def _is_alive(pid: int) -> bool:
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except FileNotFoundError:
        return False
    return state != "Z"


class Place:
    def __init__(self, tmp_path: Path, config: dict[str, bool]) -> None:
        self.url, self.work = f"file://{tmp_path}/store", tmp_path / "work"
        self.program = tmp_path / "program.py"
        self.program.write_text(PROGRAM)
        self.catalog = Catalog(Store.open(self.url))
        queue_build(self.catalog, tmp_path, config=config)

    def start(self, *options: str) -> subprocess.Popen[bytes]:
        command = [sys.executable, str(self.program), self.url, str(self.work), *options]
        stdin = subprocess.PIPE if options else None
        return subprocess.Popen(command, stdin=stdin, start_new_session=True)

    @contextmanager
    def hanging(self, *options: str) -> Iterator[subprocess.Popen[bytes]]:
        """A worker in the midst of its second stage, its status on record."""
        with self.start(*options) as worker:
            try:
                wait_until((self.work / "hangs").exists)
                wait_until(lambda: self.catalog.builds.status("b1")["stage"] == "two")
                yield worker
            finally:
                worker.kill()

    def pool_pid(self) -> int:
        return int((self.work / "pool.pid").read_text())

    def finish(self) -> None:
        (self.work / "go").write_text("")
        with self.start() as worker:
            assert worker.wait(LIMIT_S) == 0
        status = self.catalog.builds.status("b1")
        assert status["state"] == "succeeded"
        assert status["version"] == self.catalog.active_version("hall")
        assert (self.work / "made").read_text() == "first\n"  # the finished stage was not made again
        assert len(self.catalog.log("hall")) == 2


@pytest.fixture
def place(tmp_path: Path) -> Place:
    return Place(tmp_path, {"in_pool": False})


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_stopped_worker_leaves_the_build_queued_and_is_gone_soon(
    number: signal.Signals, place: Place
) -> None:
    with place.hanging() as worker:
        worker.send_signal(number)
        assert worker.wait(LIMIT_S) == 75
    status = place.catalog.builds.status("b1")
    assert (status["state"], status["stage"]) == ("queued", "two")
    wait_until(lambda: not _is_alive(place.pool_pid()))
    place.finish()


def test_a_stop_of_the_whole_process_group_is_no_failure(tmp_path: Path) -> None:
    place = Place(tmp_path, {"in_pool": True})
    with place.hanging() as worker:
        os.killpg(worker.pid, signal.SIGTERM)  # the pool breaks under the stage in the same moment
        assert worker.wait(LIMIT_S) == 75
    assert place.catalog.builds.status("b1")["state"] == "queued"
    place.finish()


def test_a_killed_worker_is_gone_on_with(place: Place) -> None:
    with place.hanging() as worker:
        worker.send_signal(signal.SIGKILL)
        worker.wait(LIMIT_S)
    wait_until(lambda: not _is_alive(place.pool_pid()))  # the pool does not outlive it
    place.finish()


def test_a_worker_stops_when_whoever_started_it_is_gone(place: Place) -> None:
    with place.hanging("tied") as worker:
        assert worker.stdin is not None
        worker.stdin.close()
        assert worker.wait(LIMIT_S) == 75
    assert place.catalog.builds.status("b1")["state"] == "queued"
    wait_until(lambda: not _is_alive(place.pool_pid()))
    place.finish()


def test_a_cancel_that_the_stages_ignore_ends_the_process(place: Place) -> None:
    with place.hanging() as worker:
        place.catalog.builds.request_cancel("b1")
        assert worker.wait(LIMIT_S) == 3
    assert place.catalog.builds.status("b1")["state"] == "cancelled"
    assert place.catalog.log("hall") == []
    wait_until(lambda: not _is_alive(place.pool_pid()))


def test_a_kill_after_the_publish_and_before_the_last_status(place: Place) -> None:
    place.work.mkdir()
    place.finish()
    published = place.catalog.log("hall")
    place.catalog.store.delete("builds/b1/status.json")
    place.finish()
    assert place.catalog.log("hall") == published


def test_workers_killed_at_random_moments_lose_nothing(place: Place) -> None:
    place.work.mkdir()
    (place.work / "go").write_text("")
    for delay_s in (0.3, 0.5, 0.7, 0.9):
        with place.start() as worker:
            let_pass(delay_s)
            os.kill(worker.pid, signal.SIGKILL)
            worker.wait()
    place.finish()
    assert [path.name for path in (place.work / "stages").glob(".*")] == []
