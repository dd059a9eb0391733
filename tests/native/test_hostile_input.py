"""Hostile input to the kernels: wrong arguments from Python, and random data under sanitizers."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.waiting import LIMIT_S

PROGRAM = Path(__file__).with_name("hostile_calls.py")


def test_no_argument_crashes_a_kernel():
    """In a process of its own, so that a crash is a failure of this test alone."""
    done = subprocess.run(
        [sys.executable, "-X", "faulthandler", PROGRAM],
        capture_output=True,
        text=True,
        check=False,
        timeout=LIMIT_S,
    )
    assert done.returncode == 0, f"{done.stdout[-200:]}\n{done.stderr[-3000:]}"
    counted = re.search(r"(\d+) refused, (\d+) gave a result", done.stdout)
    assert counted
    refused, given = map(int, counted.groups())
    assert refused > 1000
    assert given > 1000


REPO = Path(__file__).resolve().parents[2]
SOURCES = REPO / "native/tests"
BUILT = REPO / "build/sanitized"  # stays, so that only what has changed is compiled again
PROGRAMS = sorted(source.stem for source in SOURCES.glob("fuzz_*.cpp"))
# Each compiles a room of the core with sanitizers.


def run(*command: str | Path) -> None:
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=3 * LIMIT_S)
    assert done.returncode == 0, f"{done.stdout[-3000:]}\n{done.stderr[-6000:]}"


@pytest.fixture(scope="module")
def folder() -> Path:
    for program in ("cmake", "c++", "make"):
        if shutil.which(program) is None:
            pytest.skip(f"needs {program}: apt-get install cmake g++ make")
    run("cmake", "-S", SOURCES, "-B", BUILT)
    return BUILT


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("program", PROGRAMS)
def test_no_kernel_reads_outside_an_array(folder: Path, program: str):
    run("cmake", "--build", folder, "--target", program)
    run(folder / program)


@pytest.mark.slow
def test_every_room_with_kernels_is_tried():
    assert {"fuzz_descriptor", "fuzz_query", "fuzz_registration", "fuzz_scan", "fuzz_wire"} <= set(PROGRAMS)
