"""Builds of the C++ client, and the service that they ask (as in tests/service)."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from firstfix.engine.verification.seen_free import SeenFree
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


ON_BOARD = ("firstfix_similar_places", "firstfix_localize_here", "firstfix_clouds", "firstfix_cancelled")


@pytest.fixture(scope="session")
def on_board(once_a_run: OnceARun) -> Build:
    """The programs that need no service, with optimisation."""
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


@pytest.fixture(scope="session")
def folder(small_version, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The small world's version as it lies in a store, with space that a mapping run saw free."""
    rng = np.random.default_rng(5)
    brick = np.argwhere(rng.random((12, 10, 3)) < 0.3) - [6, 5, 1]
    bits = (rng.integers(-(2**31), 2**31, (len(brick), 8, 2)) & 0x01010101).astype(np.int32)
    built = tmp_path_factory.mktemp("built") / "version"
    shutil.copytree(small_version.directory, built)
    SeenFree.of_bricks(brick, bits, 0.2).save(built)
    return stored(built, tmp_path_factory.mktemp("versions"))
