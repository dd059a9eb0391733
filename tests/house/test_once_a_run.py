"""Shared folders of the tests are made once, also when the worker that makes one is killed."""

from __future__ import annotations

import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from tests.once_a_run import OnceARun

TESTS = Path(__file__).parents[1]
MAKE = """
import sys
from pathlib import Path
from tests.once_a_run import OnceARun

root, then = Path(sys.argv[1]), sys.argv[2]

def make(folder):
    with (root / "makers").open("a") as makers:
        makers.write("x")
    (folder / "half").touch()
    if then == "hang":
        print("making", flush=True)
        sys.stdin.read()
    (folder / "whole").touch()

print(OnceARun(root).folder("dear", make))
"""


def worker(root: Path, then: str = "end") -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-c", MAKE, str(root), then],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        cwd=TESTS,
    )


def test_workers_at_the_same_time_make_it_once(tmp_path: Path):
    workers = [worker(tmp_path) for _ in range(3)]
    assert {one.communicate()[0].strip() for one in workers} == {str(tmp_path / "dear")}
    assert (tmp_path / "makers").read_text() == "x"


def test_a_worker_that_is_killed_leaves_nobody_waiting(tmp_path: Path):
    first = worker(tmp_path, "hang")
    assert first.stdout is not None
    assert first.stdout.readline() == "making\n"
    with ThreadPoolExecutor(1) as threads:
        waiting = threads.submit(worker(tmp_path).communicate)
        first.send_signal(signal.SIGKILL)
        assert waiting.result()[0].strip() == str(tmp_path / "dear")
    first.communicate()
    assert (tmp_path / "dear" / "whole").exists()
    assert (tmp_path / "makers").read_text() == "xx"


def test_what_could_not_be_made_is_tried_by_the_next(tmp_path: Path):
    def fail(folder: Path) -> None:
        (folder / "half").touch()
        raise ValueError("no room")

    shared = OnceARun(tmp_path)
    with pytest.raises(ValueError, match="no room"):
        shared.folder("dear", fail)
    folder = shared.folder("dear", lambda folder: (folder / "whole").touch())
    assert {path.name for path in folder.iterdir()} >= {"whole"}
    assert not (folder / "half").exists(), "nothing of the first attempt"
