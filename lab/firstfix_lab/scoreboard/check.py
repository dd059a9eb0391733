"""Tells which results are older than the code, by how many commits, and how long new ones would take."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from .result import Result, UnreadableResult
from .run import is_old
from .suites import Suite
from .tree import commits_since


def check(suites: Iterable[Suite], repo: Path, results: Path) -> list[str]:
    """A line for each suite, and one for all that would have to be measured again."""
    lines, old_s = [], []
    for suite in suites:
        try:
            found = Result.load(results, suite.name)
        except UnreadableResult as error:
            lines.append(f"{suite.name}: its result cannot be read: {error}")
            continue
        if found is None:
            lines.append(f"{suite.name}: no result")
        elif paths := is_old(found, suite, repo):
            old_s.append(found.run_s)
            since = f"measured at {found.measured_at}, {_age(commits_since(repo, found.commit, paths))}"
            lines.append(f"{suite.name}: {since} ({', '.join(paths)}): {_minutes(found.run_s)}")
        else:
            lines.append(f"{suite.name}: measured at {found.measured_at}, of the present code")
    return [*lines, f"{len(old_s)} older than the code, to measure them again: {_minutes(sum(old_s))}"]


def _age(commits: int | None) -> str:
    if commits is None:
        return "older than the code by commits that this clone does not have"
    return f"{commits} commit{'' if commits == 1 else 's'} older than the code"


def _minutes(seconds: float) -> str:
    return f"{seconds / 60:.0f} min"
