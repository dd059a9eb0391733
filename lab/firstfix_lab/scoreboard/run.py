"""Runs suites of one commit, each in a process of its own, and keeps their results."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

from .machine import machine, versions
from .result import Cases, Result, ResultTooLarge, UnreadableResult
from .suites import Suite
from .tree import changed, commit_of, object_ids, uncommitted


class NotOneCommit(Exception):
    """The work tree differs from the commit, so a result would not be of the commit."""


def run(
    suites: Iterable[Suite], repo: Path, results: Path, *, quick: bool, say: Callable[[str], None]
) -> dict[str, str]:
    """Measure the suites that have no result of the present code.

    Args:
        repo: the checkout.
        results: folder of the results.
        quick: run the small version of each, of the work tree as it is.
        say: is given a line of progress.

    Returns:
        What became of each suite, by its name.

    Raises:
        NotOneCommit: the work tree has changes that are not committed.
    """
    if not quick and (files := uncommitted(repo)):
        raise NotOneCommit(f"commit first, or put aside: {', '.join(files[:10])}")
    told = {}
    for suite in suites:
        told[suite.name] = _one(suite, repo, results, quick, say)
        say(f"{suite.name}: {told[suite.name]}")
    return told


def is_old(result: Result, suite: Suite, repo: Path) -> list[str]:
    """The measured paths that are others by now, or that the result does not know."""
    unknown = [path for path in suite.measured if path not in result.measured]
    return unknown + changed(repo, result.measured)


def _one(suite: Suite, repo: Path, results: Path, quick: bool, say: Callable[[str], None]) -> str:
    try:
        found = Result.load(results, suite.name)
    except UnreadableResult as error:
        say(f"{suite.name}: measured anew, its result cannot be read: {error}")
        found = None
    arguments = suite.quick if quick else suite.arguments
    if arguments is None:
        return "skipped: it has no quick version"
    command = _command(suite, arguments)
    if found is not None and found.command == command and not is_old(found, suite, repo):
        return "left out: its result is of the present code"
    say(f"{suite.name}: {command}")
    before = commit_of(repo), object_ids(repo, suite.measured)
    began, clock = datetime.now(timezone.utc), time.monotonic()
    on = machine()
    figures = _figures(suite, arguments, repo)
    if isinstance(figures, str):
        return figures
    seconds = round(time.monotonic() - clock, 1)
    if not quick and (files := uncommitted(repo, suite.measured) or changed(repo, before[1])):
        return f"failed: its code was changed meanwhile: {', '.join(files[:10])}"
    cases = _cases(suite, repo, clock_began=began.timestamp())
    stamp = began.isoformat(timespec="seconds")
    result = Result(suite.name, *before, command, quick, stamp, seconds, on, versions(), figures, cases)
    try:
        size = result.save(results)
    except ResultTooLarge as error:
        return f"failed: {error}"
    skipped = "".join(f"; {line}" for line in skipped_parts(figures))
    return f"measured in {seconds:.0f} s, {size} bytes{skipped}"


def _command(suite: Suite, arguments: tuple[str, ...]) -> str:
    return f"firstfix-lab {' '.join(arguments)}"


def skipped_parts(figures: Any, name: str = "") -> list[str]:
    """The parts of a suite that it skipped, and why, as it says itself."""
    if isinstance(figures, str):
        return [f"{name} {figures}"] if figures.startswith("skipped: ") else []
    if not isinstance(figures, dict):
        return []
    return [line for key, value in figures.items() for line in skipped_parts(value, f"{name} {key}".strip())]


def _figures(suite: Suite, arguments: tuple[str, ...], repo: Path) -> Any:
    """The figures, or why there are none."""
    with tempfile.TemporaryDirectory(prefix="firstfix-scoreboard-") as folder:
        path = Path(folder) / "figures.json"
        own = ["--json", str(path)] if suite.json_option else []
        command = [sys.executable, "-m", suite.module, *arguments, *own]
        done = subprocess.run(command, cwd=repo, stdout=subprocess.PIPE, text=True, check=False)
        if done.returncode:
            return f"failed: the suite ended with {done.returncode}, see above"
        return json.loads(path.read_text()) if suite.json_option else {"lines": done.stdout.splitlines()}


def _cases(suite: Suite, repo: Path, clock_began: float) -> Cases | None:
    """Cases that this run has left, not an older one."""
    path = repo / suite.cases
    if not suite.cases or not path.exists() or path.stat().st_mtime < clock_began:
        return None
    return Cases.read(path)
