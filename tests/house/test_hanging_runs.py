"""A run of the tests ends, whatever hangs or dies in it, and leaves no process."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import psutil
import pytest

from tests.harness.dead_workers import OF_THE_ENGINE, FilesOfTheDead, pytest_collection_modifyitems
from tests.waiting import LIMIT_S, wait_until

TESTS = Path(__file__).parents[1]
REAPER = [sys.executable, str(TESTS / "harness/reaper.py")]
CONFTEST = """
import tests.harness.left_behind
import tests.harness.running_tests
import tests.harness.time_limits

tests.harness.left_behind.LIMIT_S = 1
tests.harness.running_tests.SILENT_S = 1
tests.harness.time_limits.BACKSTOP_S = 1
pytest_plugins = [
    "tests.harness.time_limits", "tests.harness.running_tests",
    "tests.harness.dead_workers", "tests.harness.left_behind",
]
"""
WORKERS = ["-n", "2", "--dist", "loadfile", "--no-loadscope-reorder", "--max-worker-restart", "3"]
HANGS = """
import ctypes, pytest, threading, time

@pytest.mark.timeout(1)
def test_in_python():
    threading.Thread(target=lambda: time.sleep(5), name="the-other-thread").start()
    time.sleep(600)

@pytest.mark.timeout(1)
@pytest.mark.parametrize("library", [ctypes.CDLL, ctypes.PyDLL])  # without and with the GIL
def test_in_c(library):
    mutex = ctypes.create_string_buffer(64)
    library(None).pthread_mutex_lock(mutex)
    library(None).pthread_mutex_lock(mutex)

@pytest.fixture
def endless():
    time.sleep(600)

@pytest.mark.timeout(1)
def test_in_a_fixture(endless):
    pass

def test_after_them():
    pass
"""

ORPHAN = "import os, time; os.close(1); time.sleep(600)"
THREADS = 90  # faulthandler prints no more than 100
MANY_THREADS = f"""
import pathlib, threading, time

def one_of_many():
    time.sleep(600)

def test_hangs():
    for _ in range({THREADS}):
        threading.Thread(target=one_of_many, daemon=True).start()
    pathlib.Path("begun-{{name}}").touch()
    time.sleep(600)
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "conftest.py").write_text(CONFTEST)
    (tmp_path / "pytest.ini").write_text("[pytest]\ntimeout = 300\ntimeout_method = signal\n")
    return tmp_path


def start(folder: Path, *options: str, limit_s: float = 2 * LIMIT_S) -> subprocess.Popen[str]:
    pytest_command = [sys.executable, "-m", "pytest", "-p", "no:schemathesis", "-p", "no:dash", "-q"]
    return subprocess.Popen(
        [*REAPER, "--limit-s", str(int(limit_s)), *pytest_command, *options],
        cwd=folder,
        env={
            **os.environ,
            "PYTHONPATH": str(TESTS.parent),
            "CI": "",
        },  # in CI pytest's summary has longer lines
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


def ended(run: subprocess.Popen[str]) -> str:
    return run.communicate(timeout=LIMIT_S)[0]


def running(mark: str) -> list[int]:
    """Processes whose last argument is ``mark``."""
    return [one.pid for one in psutil.process_iter(["cmdline"]) if (one.info["cmdline"] or [""])[-1] == mark]


def orphan(mark: str) -> str:
    """A test's first line: it starts a process whose parent ends, in a session of its own.

    The line is over when the process has closed its output. The parent ends earlier, when its child may still
    have the parent's command, by which the run would then name it.
    """
    command = ["setsid", "--fork", sys.executable, "-c", ORPHAN, mark]
    return f"    __import__('subprocess').run({command!r}, check=True, stdout=-1)\n"


def hanging(mark: str) -> str:
    return (
        f"import pathlib, time\ndef test_hangs():\n{orphan(mark)}    pathlib.Path('begun').touch()\n"
        "    time.sleep(600)\n"
    )


def test_a_hang_of_every_kind_fails_and_the_rest_is_run(folder: Path):
    (folder / "test_hangs.py").write_text(HANGS)
    said = ended(start(folder, *WORKERS))
    assert "3 failed, 1 passed" in said
    assert "1 error" in said
    assert "Stack of the-other-thread" in said
    assert said.count("in test_in_c") >= 2, "stacks from without Python"
    assert "crashed while running 'test_hangs.py::test_in_c[PyDLL]'" in said
    assert "no test has ended for" in said
    assert "test_hangs.py::test_in_c[CDLL], for" in said


def test_the_engine_is_asked_for_by_one_worker():
    asking = [
        path.relative_to(TESTS.parent).as_posix()
        for folder in ("tests", "plugins", "lab/tests")
        for path in (TESTS.parent / folder).rglob("test_*.py")
        if "build_images(" in path.read_text() and path != Path(__file__)
    ]
    assert set(asking) == OF_THE_ENGINE


def test_the_engine_s_tests_begin_first():
    one, two = sorted(OF_THE_ENGINE)[:2]
    names = ["tests/core/test_a.py::test_x", f"{one}::test_y", "tests/b.py::test_z", f"{two}::test_y"]
    items = [SimpleNamespace(nodeid=name) for name in names]
    pytest_collection_modifyitems(items)
    assert [item.nodeid for item in items] == [names[1], names[3], names[0], names[2]]


def test_the_console_s_tests_share_a_worker():
    worker_of = object.__new__(FilesOfTheDead)._split_scope
    files = [
        path
        for path in (TESTS.parent / "plugins/console/tests").glob("test_*.py")
        if "world" in path.read_text()
    ]
    assert len(files) > 1
    assert len({worker_of(f"plugins/console/tests/{path.name}::test_x") for path in files}) == 1
    alone = "plugins/console/tests/test_page_units.py"
    assert worker_of(f"{alone}::test_x") == alone


def test_a_worker_that_is_killed_holds_up_nobody_and_leaves_nothing(folder: Path):
    mark = f"left-by-{folder}"
    (folder / "test_a.py").write_text(
        f"import os\ndef test_before(): pass\ndef test_killed():\n{orphan(mark)}    os.kill(os.getpid(), 9)\n"
    )
    for name in "bcd":  # with a file of one test to give to the new worker, xdist alone waits for ever
        (folder / f"test_{name}.py").write_text("import time\ndef test_only(): time.sleep(0.1)\n")
    run = start(folder, *WORKERS)
    said = ended(run)
    assert "1 failed, 4 passed" in said
    assert said.count("crashed while running 'test_a.py::test_killed'") == 1
    assert run.returncode == 1
    assert mark in said
    assert running(mark) == []


@pytest.mark.parametrize("options", [[], WORKERS])
def test_what_tests_leave_behind_is_named_and_ended(folder: Path, options: list[str]):
    mark = f"left-by-{folder}"
    (folder / "test_a.py").write_text(f"def test_one():\n{orphan(mark)}")
    run = start(folder, *options)
    said = ended(run)
    assert "1 passed" in said
    assert f"left behind by the tests: {sys.executable} -c {ORPHAN} {mark}" in said
    assert "first seen in test_a.py" in said
    assert run.returncode == 1
    assert running(mark) == []


def test_a_process_without_a_command_is_left_behind_too(folder: Path):
    """So looks one that begins a program just now: it was taken for a zombie, and the run passed."""
    (folder / "test_a.py").write_text(
        "import subprocess\n"
        "def test_one():\n"
        "    global left\n"
        "    left = subprocess.Popen([''], executable='/bin/cat', stdin=subprocess.PIPE)\n"
        "    while open(f'/proc/{left.pid}/comm').read() != 'cat\\n': pass\n"
    )
    run = start(folder)
    said = ended(run)
    assert "left behind by the tests: cat (first seen in test_a.py)" in said
    assert run.returncode == 1


@pytest.mark.parametrize("options", [[], WORKERS])
def test_a_run_ends_at_its_limit_with_names_and_stacks(folder: Path, options: list[str]):
    mark = f"left-by-{folder}"
    (folder / "test_a.py").write_text(hanging(mark))
    run = start(folder, *options)
    assert run.stdout is not None
    lines = iter(run.stdout.readline, "")
    assert any("test_a.py::test_hangs, for" in line for line in lines), "the controller knows of it"
    # It knows before the worker is in the test itself, whose stack is to be seen.
    wait_until(lambda: (folder / "begun").exists())
    run.send_signal(signal.SIGTERM)  # as at the limit
    said = run.stdout.read()
    run.wait(LIMIT_S)
    assert "asked to end; running:\n    test_a.py::test_hangs, for" in said
    assert "in test_hangs\n" in said
    assert "Exit: asked to end" in said, "the summary"
    assert run.returncode == pytest.ExitCode.INTERRUPTED
    assert running(mark) == []


def test_stacks_of_two_workers_are_not_mixed(folder: Path):
    """Workers printed into one pipe, 2 s apart: one that was late on a busy machine tore another's lines.

    Now each prints into a file of its own, which the controller prints once the worker has ended.
    """
    for name in "ab":
        (folder / f"test_{name}.py").write_text(MANY_THREADS.format(name=name))
    run = start(folder, *WORKERS)
    wait_until(lambda: len(list(folder.glob("begun-*"))) == 2)
    run.send_signal(signal.SIGTERM)
    said = ended(run)
    assert run.returncode == pytest.ExitCode.INTERRUPTED, said[-2000:]
    _, *parts = re.split("stacks of gw[01]:\n", said)
    frame = re.compile(r'test_(.)\.py", line \d+ in (one_of_many|test_hangs)\n')
    frames = [sorted(frame.findall(part)) for part in parts]
    assert sorted(frames) == [[(name, "one_of_many")] * THREADS + [(name, "test_hangs")] for name in "ab"]


def test_a_command_that_does_not_listen_is_killed():
    deaf = "import signal, time; signal.signal(signal.SIGTERM, signal.SIG_IGN); time.sleep(600)"
    code = f"""
import sys
from tests.harness import reaper

reaper.GRACE_S = 1
sys.exit(reaper.run([sys.executable, "-c", {deaf!r}], 1))
"""
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=TESTS.parent, capture_output=True, text=True, timeout=LIMIT_S
    )
    assert done.returncode == 128 + signal.SIGKILL
    assert "the limit of 1 s is reached" in done.stderr


def test_all_ends_with_whoever_started_it(folder: Path):
    mark = f"left-by-{folder}"
    (folder / "test_a.py").write_text(hanging(mark))
    run = start(folder, *WORKERS)
    wait_until(lambda: (folder / "begun").exists())
    (controller,) = psutil.Process(run.pid).children()
    controller.kill()
    ended(run)
    assert running(mark) == []
