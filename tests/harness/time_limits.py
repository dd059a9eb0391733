"""Limits of time: a test that hangs fails with the stacks of all threads, and can hold up nobody.

pytest-timeout fails it from within (``timeout`` in pyproject.toml: what its fixtures do counts too). Python
runs its signal handler between two of its own steps, so code that never comes back from C, with or without
the GIL, is not reached: ``BACKSTOP_S`` later faulthandler's own thread prints the stacks and ends the
process.
"""

from __future__ import annotations

import faulthandler
import os
from collections.abc import Iterator
from typing import Any

import pytest

BACKSTOP_S = 60.0

# Fixtures that one test pays for, or waits for while another worker makes them: limit in seconds, and why.
LONGER: dict[str, tuple[int, str]] = {
    "small_version": (600, "builds a version of a map"),
    "coarse_version": (600, "the same"),
    "cloud_version": (600, "the same"),
    "hall_directory": (900, "builds a version of a real hall"),
    "optimised_tests": (1500, "compiles the C++ client's tests"),
    "optimised": (1500, "compiles the C++ client"),
    "sanitised": (1500, "compiles it once more, with sanitizers"),
    "on_board": (1500, "compiles the localizer without Python"),
    "sanitised_on_board": (1500, "the same, with sanitizers"),
    "on_arm": (1500, "the same, for ARM"),
    "allowed_versions": (1500, "installs all packages and compiles the core"),
    "program": (1500, "cargo gets and compiles a robot of another DDS"),
}


def pytest_configure(config: pytest.Config) -> None:
    config.stash[_ERRORS] = os.dup(2)  # what pytest captures is another's


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Gives tests that ask for a dear fixture its limit."""
    for item in items:
        asked = LONGER.keys() & set(getattr(item, "fixturenames", ()))
        marker = item.get_closest_marker("timeout")
        own = [marker.args[0]] if marker is not None else []
        if asked:
            item.add_marker(pytest.mark.timeout(max(own + [LONGER[name][0] for name in asked])), append=False)


@pytest.hookimpl(wrapper=True)
def pytest_timeout_set_timer(item: pytest.Item, settings: Any) -> Iterator[object]:
    """Sets the backstop behind the limit of pytest-timeout."""
    later = settings.timeout + BACKSTOP_S
    faulthandler.dump_traceback_later(later, exit=True, file=item.config.stash[_ERRORS])
    return (yield)


@pytest.hookimpl(wrapper=True)
def pytest_timeout_cancel_timer(item: pytest.Item) -> Iterator[object]:
    faulthandler.cancel_dump_traceback_later()
    return (yield)


def pytest_enter_pdb() -> None:
    """Lets a person take their time."""
    faulthandler.cancel_dump_traceback_later()


_ERRORS = pytest.StashKey[int]()
