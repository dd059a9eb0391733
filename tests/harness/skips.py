"""A test that is skipped in CI has failed: `.ci/run` installs what it needs.

On a user's machine a skip says what is missing and how to get it (``needs``).
"""

from __future__ import annotations

import os
from collections.abc import Iterator

import pytest

IN_CI = bool(os.environ.get("CI"))

# Parts of the reasons that CI may have too, each with why.
EVEN_IN_CI = {
    "cargo": "the robot of another DDS: cargo is only looked for",
    "crates": "the same",
    "g++-aarch64-linux-gnu": "cross compilers of 500 MB",
    "fake-gcs-server": "a hundred modules, and minutes to build them",
    "rerun": "a wheel of 170 MB",
    "Landlock": "the kernel is what it is",
    "this processor runs": "the processor is what it is",
    "network namespaces": "the kernel's rights are what they are",
    "image can be mounted": "the kernel's rights are what they are",
}


def _is_wrong(reason: str) -> bool:
    return IN_CI and not any(part in reason for part in EVEN_IN_CI)


def _fail(report: pytest.CollectReport | pytest.TestReport) -> None:
    if report.skipped and not hasattr(report, "wasxfail") and isinstance(report.longrepr, tuple):
        path, line, reason = report.longrepr
        if _is_wrong(reason):
            report.outcome = "failed"
            report.longrepr = f"{path}:{line}: skipped in CI, which should have it: {reason}"


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport() -> Iterator[None]:
    report = yield
    _fail(report)
    return report


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report() -> Iterator[None]:
    report = yield
    _fail(report)
    return report
