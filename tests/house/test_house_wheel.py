"""The house's wheel has all of its modules, and nothing of what may be left out."""

from __future__ import annotations

import subprocess
import sys
import zipfile
from importlib.util import find_spec
from pathlib import Path

import pytest

REPO = Path(__file__).resolve().parents[2]
FOLDERS = ("core", "builder", "service", "clients/python", "clients/ros2", "cli")


def test_the_wheel_has_every_module_of_the_house_and_no_other(tmp_path: Path):
    if find_spec("scikit_build_core") is None:
        pytest.skip("needs scikit-build-core: scripts/setup.sh installs it")
    command = [
        sys.executable,
        "-m",
        "pip",
        "wheel",
        "--quiet",
        "--no-deps",
        "--no-build-isolation",
        "--no-index",
    ]
    command += ["--config-settings", "wheel.cmake=false", "--wheel-dir", str(tmp_path), str(REPO)]
    subprocess.run(command, check=True, capture_output=True)
    (built,) = tmp_path.glob("*.whl")
    with zipfile.ZipFile(built) as archive:
        held = {name for name in archive.namelist() if name.endswith(".py")}
    assert held == {
        path.relative_to(REPO / folder).as_posix()
        for folder in FOLDERS
        for path in (REPO / folder).glob("firstfix*/**/*.py")
    }
