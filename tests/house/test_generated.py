"""Comparison of what is told of the code elsewhere with the code."""

import runpy
from pathlib import Path

import pytest

from firstfix.doors import absent

pytestmark = pytest.mark.skipif(bool(absent()), reason="openapi.json has the routes of all packages")
REPO = Path(__file__).resolve().parents[2]


def test_what_is_checked_in_is_what_the_code_says():
    generated = runpy.run_path(str(REPO / "scripts" / "generate.py"))["generated"]()
    for path, text in generated.items():
        assert path.read_text() == text, f"python scripts/generate.py writes {path.relative_to(REPO)} anew"
