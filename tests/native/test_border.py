"""The border between Python and the kernels: wrong arguments are refused, or harmless."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

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
