"""Asks git about a checkout: its commit, the object ids of paths, and uncommitted files."""

from __future__ import annotations

import subprocess
from collections.abc import Iterable, Mapping
from pathlib import Path


def commit_of(repo: Path) -> str:
    """The present commit."""
    return _git(repo, "rev-parse", "HEAD").strip()


def object_ids(repo: Path, paths: Iterable[str]) -> dict[str, str]:
    """The object id of each path in the present commit; empty: there is no such path.

    They depend on the content alone, so they can be compared in a clone without the history.
    """
    listed = _git(repo, "ls-tree", "-z", "--full-tree", "HEAD", "--", *(wanted := list(paths)))
    found = {}
    for line in filter(None, listed.split("\0")):
        about, _, path = line.partition("\t")
        found[path] = about.split()[2]
    return {path: found.get(path, "") for path in wanted}


def uncommitted(repo: Path, paths: Iterable[str] = ()) -> list[str]:
    """The files that differ from the present commit, new ones among them.

    Args:
        paths: are looked at alone; empty: all.
    """
    return [line[3:] for line in _git(repo, "status", "--porcelain", "--", *paths).splitlines()]


def changed(repo: Path, measured: Mapping[str, str]) -> list[str]:
    """The paths whose code is another than when they were measured."""
    now = object_ids(repo, measured)
    return [path for path, measured_id in measured.items() if now[path] != measured_id]


def commits_since(repo: Path, commit: str, paths: Iterable[str]) -> int | None:
    """How many commits since another one touch the paths; None: this clone does not have that one."""
    known = subprocess.run(
        ["git", "-C", str(repo), "cat-file", "-e", f"{commit}^{{commit}}"], capture_output=True, check=False
    )
    if known.returncode:
        return None
    return int(_git(repo, "rev-list", "--count", f"{commit}..HEAD", "--", *paths))


def _git(repo: Path, *arguments: str) -> str:
    command = ["git", "-C", str(repo), *arguments]
    return subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout
