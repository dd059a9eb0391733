"""Process ids of the query workers that this process started."""

from __future__ import annotations

import os
from pathlib import Path


class Workers:
    """The query workers that this process starts from now on: other fixtures keep services with theirs."""

    def __init__(self) -> None:
        self._others = frozenset(_worker_pids())

    def pids(self) -> list[int]:
        return sorted(_worker_pids() - self._others)


def _worker_pids() -> set[int]:
    found = set()
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                command = (entry / "cmdline").read_bytes()
                parent = int((entry / "stat").read_text().rsplit(")", 1)[1].split()[1])
            except (OSError, IndexError):
                continue
            if parent == os.getpid() and b"firstfix_service.query_workers.worker" in command:
                found.add(int(entry.name))
    return found
