"""The C++ client's programs, built once; they ask a service that runs as those of tests/service do."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from cpp_build import SANITISED, Build, build, require_toolchain

sys.path.append(str(Path(__file__).resolve().parents[1] / "service"))  # service_world


@pytest.fixture(scope="session")
def optimised(tmp_path_factory: pytest.TempPathFactory) -> Build:
    """As a robot would have it, every warning an error."""
    require_toolchain()
    return build(tmp_path_factory.mktemp("optimised"), "-O1", "firstfix_conformance", "firstfix_localize")


@pytest.fixture(scope="session")
def sanitised(tmp_path_factory: pytest.TempPathFactory) -> Build:
    """Every access and every operation checked as it runs."""
    require_toolchain()
    return build(tmp_path_factory.mktemp("sanitised"), SANITISED)
