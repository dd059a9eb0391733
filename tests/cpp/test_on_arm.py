"""Localizing on a robot with a 64-bit ARM processor: built with a cross compiler, run in an emulator."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from firstfix.scan.condense import condense
from firstfix.wire.scan import encode_scan
from firstfix.wire.sequence import encode_scans
from tests.cpp.cpp_build import REPO, Build, build
from tests.needs import needs, recorded
from tests.once_a_run import OnceARun
from tests.ros_samples import cdr, cloud
from tests.waiting import LIMIT_S

pytestmark = pytest.mark.slow

CROSS, EMULATOR = "aarch64-linux-gnu-g++", "qemu-aarch64"
SYSTEM, LIBRARIES = Path("/usr/aarch64-linux-gnu"), REPO / ".venv/arm-libraries"
FOLDER, TRIPLE, PROGRAM = REPO / "build/cpp-arm", "aarch64-linux-gnu", "firstfix_localize_here"
FOR_ARM = (
    "-DCMAKE_SYSTEM_NAME=Linux",
    "-DCMAKE_SYSTEM_PROCESSOR=aarch64",
    f"-DCMAKE_CXX_COMPILER={CROSS}",
    "-DFIRSTFIX_CLIENT=OFF",
    "-DFIRSTFIX_SIGNING=OFF",
    f"-DCMAKE_EXE_LINKER_FLAGS=-L{LIBRARIES / 'usr/lib' / TRIPLE}",
)


@pytest.fixture(scope="module")
def on_arm(once_a_run: OnceARun) -> Path:
    """The program for ARM."""
    for program in (CROSS, EMULATOR):
        if shutil.which(program) is None:
            pytest.skip(needs(program, "make all-test-servers installs it"))
    if not LIBRARIES.is_dir():
        pytest.skip(needs("the C++ client's libraries for ARM", "make all-test-servers gets them"))
    found = {
        "PKG_CONFIG_LIBDIR": str(LIBRARIES / "usr/lib" / TRIPLE / "pkgconfig"),
        "PKG_CONFIG_SYSROOT_DIR": str(LIBRARIES),
    }
    flags = f"-O1 -isystem {LIBRARIES / 'usr/include' / TRIPLE}"
    once_a_run.folder("cpp-arm", lambda _: build(FOLDER, flags, PROGRAM, options=FOR_ARM, more=found))
    return FOLDER / PROGRAM


def run_on_arm(program: Path, *arguments: object) -> subprocess.CompletedProcess[str]:
    libraries = f"LD_LIBRARY_PATH={LIBRARIES / 'usr/lib' / TRIPLE}:{SYSTEM / 'lib'}"
    command = [EMULATOR, "-L", str(SYSTEM), "-E", libraries, str(program), *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=LIMIT_S)


def test_it_answers_to_the_last_bit(
    on_arm: Path, on_board: Build, version_folder: Path, small_scans, tmp_path: Path
):
    scans, poses = zip(*small_scans[:2], strict=True)
    bodies = {
        "scan": encode_scan(scans[0]),
        "way": encode_scans(scans, poses),
        "compact": encode_scans([condense(scan) for scan in scans], poses),
    }
    for name, body in bodies.items():
        path = tmp_path / f"{name}.ffscan"
        path.write_bytes(body)
        there, here = run_on_arm(on_arm, version_folder, path), on_board.run(PROGRAM, version_folder, path)
        assert here.stdout.startswith("verdict localized"), here.stderr
        assert (there.stdout, there.returncode) == (here.stdout, here.returncode), there.stderr


def test_messages_maps_and_findings_are_the_same(
    on_arm: Path, on_board: Build, version_folder: Path, small_scans, tmp_path: Path
):
    """A PointCloud2 in both byte orders, two maps on board, and a scan whose cause is sought."""
    scan, _ = small_scans[0]
    made = np.zeros(len(scan), [("x", "f4"), ("y", "f4"), ("z", "f4"), ("t", "u4")])
    for number, axis in enumerate("xyz"):
        made[axis] = scan.points[:, number]
    made["t"] = np.linspace(0, 1e8, len(scan))
    mirrored = made.copy()
    mirrored["y"] = -mirrored["y"]
    swapped = made.astype(made.dtype.newbyteorder(">"))
    path, maps = tmp_path / "scan.cdr", f"yard={version_folder},copy={version_folder}"
    for message, folder in ((made, version_folder), (swapped, maps), (mirrored, version_folder)):
        path.write_bytes(cdr(cloud(message), little_endian=message is not swapped))
        there = run_on_arm(on_arm, folder, path, "explaining=inf")
        here = on_board.run(PROGRAM, folder, path, "explaining=inf")
        assert here.stdout.startswith("verdict"), here.stderr
        assert (there.stdout, there.stderr) == (here.stdout, here.stderr)
    assert "mirrored: " in here.stderr


def test_it_answers_to_the_last_bit_in_a_real_hall(on_arm: Path, on_board: Build, hall_directory: Path):
    path = min((recorded("hilti_hall_indoor") / "queries").glob("*.pcd"))
    there, here = run_on_arm(on_arm, hall_directory, path), on_board.run(PROGRAM, hall_directory, path)
    assert here.stdout.startswith("verdict"), here.stderr
    assert (there.stdout, there.returncode) == (here.stdout, here.returncode), there.stderr
