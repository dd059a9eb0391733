"""The kernels on a 64-bit ARM processor: they compile, and a robot there computes what one here does.

That one here passes the golden vectors is tested in ``tests/cpp``.
"""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from tests.waiting import LIMIT_S

REPO = Path(__file__).resolve().parents[2]
HEADERS = REPO / "native" / "include"
SCANS = sorted((REPO / "clients/conformance/vectors/inputs").glob("*.f32"))
CROSS, EMULATOR = "aarch64-linux-gnu-g++", "qemu-aarch64"
# -fno-trapping-math lets the compiler use vectors: NEON is in every such processor.
FLAGS = ["-std=c++17", "-O3", "-ffp-contract=off", "-fno-math-errno", "-fno-trapping-math", "-Wno-psabi"]


def run(*command: str | Path) -> str:
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=LIMIT_S)
    assert done.returncode == 0, done.stderr[-3000:]
    return done.stdout


def need(*programs: str) -> None:
    for program in programs:
        if shutil.which(program) is None:
            pytest.skip(f"needs {program}: apt-get install g++-aarch64-linux-gnu qemu-user")


@pytest.mark.parametrize("compiler", ["c++", pytest.param(CROSS, marks=pytest.mark.slow)])
def test_every_header_compiles_beside_the_others(compiler: str, tmp_path: Path):
    need(compiler)
    names = [path.relative_to(HEADERS).as_posix() for path in sorted(HEADERS.rglob("*.hpp"))]
    # no library for ARM is here
    with_zstd = {"points", "query", "range_image", "scan", "sequence", "times", "zstd_frame"}
    chosen = [
        name for name in names if not name.startswith("firstfix/wire/") or Path(name).stem not in with_zstd
    ]
    assert len(chosen) > 20
    source = tmp_path / "all.cpp"
    source.write_text("".join(f'#include "{name}"\n' for name in chosen))
    run(compiler, *FLAGS, "-Wall", "-Wextra", "-Werror", "-fsyntax-only", f"-I{HEADERS}", source)


@pytest.mark.slow
def test_a_robot_computes_the_same(tmp_path: Path):
    need("c++", CROSS, EMULATOR)
    scans = [path for path in SCANS if path.stat().st_size % 12 == 0]  # the others hold intensities
    assert {"room", "street"} <= {path.stem for path in scans}
    printed = []
    for compiler, runner in (("c++", []), (CROSS, [EMULATOR])):
        program = tmp_path / compiler
        source = REPO / "native/tests/digests.cpp"
        run(compiler, *FLAGS, "-static", f"-I{HEADERS}", source, "-o", program)
        printed.append(run(*runner, program, *scans))
    here, there = printed
    assert here.count("\n") == 3 * len(scans) + 3
    assert here == there
