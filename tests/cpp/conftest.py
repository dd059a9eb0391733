"""Builds of the C++ client, and the service that they ask (as in tests/service)."""

from __future__ import annotations

import pytest

from tests.cpp.cpp_build import OPTIMISED, REPO, SANITISED, Build, build, require_toolchain
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


PLACES = "firstfix_similar_places"


@pytest.fixture(scope="session")
def places(once_a_run: OnceARun) -> Build:
    """The example that finds similar places, with optimisation."""
    require_toolchain()
    once_a_run.folder("cpp-places", lambda folder: build(OPTIMISED_FOLDER, OPTIMISED, PLACES))
    return Build(OPTIMISED_FOLDER)


@pytest.fixture(scope="session")
def sanitised_places(once_a_run: OnceARun) -> Build:
    """The same with checks of every memory access and operation."""
    require_toolchain()
    once_a_run.folder("cpp-sanitised-places", lambda folder: build(SANITISED_FOLDER, SANITISED, PLACES))
    return Build(SANITISED_FOLDER)
