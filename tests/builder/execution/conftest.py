"""Fixtures of the tests of chunks: a stage of numbers that they read, and a folder that counts their runs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from firstfix_builder.execution.stage_cache import StageResult


@pytest.fixture
def log(tmp_path: Path) -> Path:
    (tmp_path / "log").mkdir()
    return tmp_path / "log"


@pytest.fixture
def numbers(tmp_path: Path) -> StageResult:
    (tmp_path / "numbers").mkdir()
    np.save(tmp_path / "numbers" / "numbers.npy", np.arange(3))
    return StageResult("6" * 64, tmp_path / "numbers", "7" * 64)
