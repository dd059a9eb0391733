"""Building and running the C++ client's programs."""

from __future__ import annotations

import os
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

import pytest

from waiting import LIMIT_S

REPO = Path(__file__).resolve().parents[2]

LIBRARIES = ("libzstd", "libcurl", "nlohmann_json")
SANITISED = "-O0 -fsanitize=address,undefined -fno-sanitize-recover=all"


@dataclass(frozen=True)
class Build:
    folder: Path

    def run(self, program: str, *arguments: object, **more: str) -> subprocess.CompletedProcess[str]:
        """With the environment, but for credentials, and ``more``."""
        environment = {name: value for name, value in os.environ.items() if name != "FIRSTFIX_API_KEY"}
        command = [self.folder / program, *map(str, arguments)]
        return subprocess.run(
            command, capture_output=True, text=True, check=False, timeout=LIMIT_S, env={**environment, **more}
        )


def build(folder: Path, flags: str, *targets: str) -> Build:
    """The programs, all of them if none is named."""
    configure = ["cmake", "-S", REPO / "clients" / "cpp", "-B", folder, f"-DCMAKE_CXX_FLAGS={flags}"]
    commands = (
        [*configure, "-DFIRSTFIX_TESTS=ON", "-DFIRSTFIX_STRICT=ON"],
        ["cmake", "--build", folder, "--parallel", "2", "--target", *(targets or ("all",))],
    )
    for command in commands:
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=3000)
        assert done.returncode == 0, f"{done.stdout[-3000:]}\n{done.stderr[-3000:]}"
    return Build(folder)


def require_toolchain() -> None:
    for program in ("cmake", "c++", "make", "pkg-config"):
        if shutil.which(program) is None:
            pytest.skip(f"{program} is not here (scripts/test-servers.sh)")
    for library in LIBRARIES:
        if subprocess.run(["pkg-config", "--exists", library], check=False).returncode:
            pytest.skip(f"the development files of {library} are not here (scripts/test-servers.sh)")
