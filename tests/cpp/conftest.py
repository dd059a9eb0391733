"""Builds of the C++ client, and the service that they ask (as in tests/service)."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.cpp.cpp_build import OPTIMISED, REPO, SANITISED, Build, build, require_toolchain
from tests.cpp.stored_versions import stored
from tests.once_a_run import OnceARun

# They stay, so that only what has changed is compiled again.
OPTIMISED_FOLDER, SANITISED_FOLDER = REPO / "build/cpp-optimised", REPO / "build/cpp-sanitised"


@pytest.fixture(scope="session")
def optimised_tests(once_a_run: OnceARun) -> Build:
    """The tests alone with optimisation, as on a robot. Every warning is an error."""
    require_toolchain()
    once_a_run.folder("cpp-tests", lambda folder: build(OPTIMISED_FOLDER, OPTIMISED, "firstfix_tests"))
    return Build(OPTIMISED_FOLDER)


@pytest.fixture(scope="session")
def optimised(optimised_tests: Build, once_a_run: OnceARun) -> Build:
    """With them the library and the example."""
    once_a_run.folder("cpp-optimised", lambda folder: build(OPTIMISED_FOLDER, OPTIMISED))
    return optimised_tests


@pytest.fixture(scope="session")
def sanitised(once_a_run: OnceARun) -> Build:
    """The tests with checks of every memory access and operation."""
    require_toolchain()
    once_a_run.folder("cpp-sanitised", lambda folder: build(SANITISED_FOLDER, SANITISED, "firstfix_tests"))
    return Build(SANITISED_FOLDER)


ON_BOARD = ("firstfix_similar_places", "firstfix_localize_here")


@pytest.fixture(scope="session")
def on_board(once_a_run: OnceARun) -> Build:
    """The examples that need no service, with optimisation."""
    require_toolchain()
    once_a_run.folder("cpp-on-board", lambda folder: build(OPTIMISED_FOLDER, OPTIMISED, *ON_BOARD))
    return Build(OPTIMISED_FOLDER)


@pytest.fixture(scope="session")
def sanitised_on_board(once_a_run: OnceARun) -> Build:
    """The same with checks of every memory access and operation."""
    require_toolchain()
    once_a_run.folder("cpp-sanitised-on-board", lambda folder: build(SANITISED_FOLDER, SANITISED, *ON_BOARD))
    return Build(SANITISED_FOLDER)


@pytest.fixture(scope="session")
def version_folder(small_version, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The small world's version as it lies in a store."""
    return stored(small_version.directory, tmp_path_factory.mktemp("versions"))


@pytest.fixture(scope="session")
def scan_file(small_scans, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One of its scans."""
    path = tmp_path_factory.mktemp("scans") / "scan.f32"
    path.write_bytes(small_scans[0][0].points.astype("<f4").tobytes())
    return path
