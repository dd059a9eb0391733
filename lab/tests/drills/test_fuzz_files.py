"""A small version of the drill ``fuzz_files``."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

from firstfix_lab.checkout import ROOT
from tests.hostile_files import FORMATS

pytestmark = pytest.mark.slow
COUNT = 200


def test_damaged_files_are_read_or_refused():
    """In a process of its own: a fork of this one would take the threads' locks along."""
    command = [
        sys.executable,
        "-m",
        "firstfix_lab",
        "fuzz_files",
        "--count",
        str(COUNT),
        "--seed",
        "7",
    ]
    ended = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    figures = {line["format"]: line for line in map(json.loads, ended.stdout.splitlines())}
    assert set(figures) == set(FORMATS), ended.stderr
    assert {name: line["defects"] for name, line in figures.items() if line["defects"]} == {}
    assert ended.returncode == 0
    assert all(sum(line["ends"].values()) == COUNT for line in figures.values())
    assert all(line["peak_mb"] < 2000 for line in figures.values())
    assert all(any(end != "read" for end in line["ends"]) for line in figures.values())
