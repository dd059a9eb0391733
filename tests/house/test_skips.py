"""A skip says what is missing and how to get it, and in CI it is a failure."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.harness.skips import EVEN_IN_CI
from tests.needs import needs
from tests.waiting import LIMIT_S

TESTS = Path(__file__).parents[1]
FILES = {
    "test_in_a_test.py": "def test_one(): pytest.skip('needs a server: start one')",
    "test_by_a_mark.py": "@pytest.mark.skipif(1, reason='needs a server: start one')\ndef test_one(): pass",
    "test_of_a_file.py": "pytest.importorskip('no_such_package', reason='needs a server: start one')",
    "test_excused.py": f"def test_one(): pytest.skip('needs {next(iter(EVEN_IN_CI))}: install it')",
    "test_expected.py": "@pytest.mark.xfail(reason='a bug')\ndef test_one(): assert False",
}


def run(folder: Path, options: list[str], **environment: str) -> subprocess.CompletedProcess[str]:
    for name, text in FILES.items():
        (folder / name).write_text(f"import pytest\n{text}\n")
    (folder / "conftest.py").write_text('pytest_plugins = ["tests.harness.skips"]\n')
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-p",
        "no:schemathesis",
        "-p",
        "no:dash",
        "-q",
        "-rs",
        *options,
    ]
    inherited = {name: value for name, value in os.environ.items() if name != "CI"}
    return subprocess.run(
        command,
        cwd=folder,
        env={**inherited, "PYTHONPATH": str(TESTS.parent), **environment},
        capture_output=True,
        text=True,
        timeout=LIMIT_S,
    )


@pytest.mark.parametrize("options", [["--continue-on-collection-errors"], ["-n", "1"]])
def test_in_ci_a_skip_is_a_failure(tmp_path: Path, options: list[str]):
    done = run(tmp_path, options, CI="true")
    assert "1 failed, 1 skipped, 1 xfailed, 2 errors" in done.stdout, done.stdout
    assert done.stdout.count("skipped in CI, which should have it: ") >= 3
    assert done.returncode == 1


def test_elsewhere_it_is_a_skip(tmp_path: Path):
    done = run(tmp_path, [])
    assert "4 skipped, 1 xfailed" in done.stdout, done.stdout
    assert done.returncode == 0


def test_a_reason_says_how_to_get_it():
    assert needs("nats-server", "make test-servers") == "needs nats-server: make test-servers"
