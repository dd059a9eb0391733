"""The program ``firstfix`` where packages of its extras are not installed."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from tests.waiting import LIMIT_S

# In the words of a package that is not installed. A None in `sys.modules` has others.
PROGRAM = """
import sys
from pathlib import Path
from importlib.abc import MetaPathFinder

class Missing(MetaPathFinder):
    def find_spec(self, name, path, target=None):
        if name in {missing!r}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)

sys.meta_path.insert(0, Missing())
sys.argv = ["firstfix", *{arguments!r}]
from firstfix_cli.entry import run
run()
"""


def test_a_missing_command_line_is_said_with_what_to_install():
    said = "the command line needs typer: pip install '.[gateway]' or '.[service]' in"
    check_what_is_said(("typer",), ("--help",), said)


def test_a_missing_reader_of_bags_is_said_with_what_to_install(tmp_path: Path):
    bag = tmp_path / "drive.bag"
    bag.write_bytes(b"#ROSBAG V2.0\n")
    arguments = ("localize", "--bag", str(bag), "--map", "hall", "--url", "http://localhost:1")
    said = "the package rosbags is not installed: pip install '.[service]' in the checkout"
    check_what_is_said(("rosbags",), arguments, said)


def check_what_is_said(missing: tuple[str, ...], arguments: tuple[str, ...], said: str) -> None:
    command = [sys.executable, "-c", PROGRAM.format(missing=missing, arguments=arguments)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=LIMIT_S, check=False)
    assert done.returncode == 2, done.stderr
    assert said in done.stderr
    assert len(done.stderr.splitlines()) <= 2
    assert "Traceback" not in done.stderr
