"""Builds and runs the programs of the C++ client."""

from __future__ import annotations

import fcntl
import os
import shutil
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.needs import needs
from tests.waiting import LIMIT_S

REPO = Path(__file__).resolve().parents[2]

LIBRARIES = ("libzstd", "libcurl", "libcrypto", "nlohmann_json")
OPTIMISED = "-O1"
SANITISED = "-O0 -fsanitize=address,undefined -fno-sanitize-recover=all"


@dataclass(frozen=True)
class Build:
    folder: Path

    def run(self, program: str, *arguments: object, **more: str) -> subprocess.CompletedProcess[str]:
        """Runs a program with this environment without credentials, and with the variables of ``more``."""
        environment = {name: value for name, value in os.environ.items() if name != "FIRSTFIX_API_KEY"}
        command = [self.folder / program, *map(str, arguments)]
        return subprocess.run(
            command, capture_output=True, text=True, check=False, timeout=LIMIT_S, env={**environment, **more}
        )


def build(
    folder: Path,
    flags: str,
    *targets: str,
    options: Sequence[str] = ("-DFIRSTFIX_TESTS=ON",),
    more: Mapping[str, str] | None = None,
) -> None:
    """Builds the named targets in the folder, one caller at a time; all targets if none is named.

    Args:
        options: of CMake.
        more: variables of the environment.
    """
    environment = {**os.environ, **(more or {})}
    configure = ["cmake", "-S", REPO / "clients" / "cpp", "-B", folder, f"-DCMAKE_CXX_FLAGS={flags}"]
    commands = (
        [*configure, *options, "-DFIRSTFIX_STRICT=ON"],
        ["cmake", "--build", folder, "--parallel", "2", "--target", *(targets or ("all",))],
    )
    folder.parent.mkdir(parents=True, exist_ok=True)
    with Path(f"{folder}.lock").open("w") as lock:
        # Two of CMake in one folder take each other's files away.
        fcntl.flock(lock, fcntl.LOCK_EX)
        for command in commands:
            done = subprocess.run(
                command, capture_output=True, text=True, check=False, timeout=3000, env=environment
            )
            assert done.returncode == 0, f"{done.stdout[-3000:]}\n{done.stderr[-3000:]}"


def require_toolchain() -> None:
    """Skips the test if a program or library for the build is missing."""
    for program in ("cmake", "c++", "make", "pkg-config"):
        if shutil.which(program) is None:
            pytest.skip(needs(program, "make test-servers installs it"))
    for library in LIBRARIES:
        if subprocess.run(["pkg-config", "--exists", library], check=False).returncode:
            pytest.skip(needs(f"the development files of {library}", "make test-servers installs them"))
