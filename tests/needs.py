"""Reasons for skipping a test: what is missing, and how to get it. In CI they are failures."""

from __future__ import annotations

from pathlib import Path

import pytest

RECORDED = Path(__file__).resolve().parents[2] / "shared" / "data"


def needs(what: str, how_to_get_it: str) -> str:
    """The reason why a test is skipped."""
    return f"needs {what}: {how_to_get_it}"


def of_recordings(name: str) -> str:
    """The reason where a folder or file of the recordings is missing."""
    return needs(f"../shared/data/{name}", "recordings beside the checkout, see Tests in CONTRIBUTING.md")


def recorded(name: str) -> Path:
    """A folder or file of the recordings; without it the test is skipped."""
    if not (RECORDED / name).exists():
        pytest.skip(of_recordings(name))
    return RECORDED / name


def with_recorded(name: str) -> pytest.MarkDecorator:
    """The mark of tests that need a folder or file of the recordings."""
    return pytest.mark.skipif(not (RECORDED / name).exists(), reason=of_recordings(name))
