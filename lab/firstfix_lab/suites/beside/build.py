"""Versions built by each checkout's own code, kept with what each stage cost."""

from __future__ import annotations

import hashlib
import json
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...checkout import ROOT
from .tree import Tree


@dataclass(frozen=True)
class Source:
    """Input of a build.

    Attributes:
        map: a map file.
        trajectory: poses of the mapping run, or None: the largest floors.
    """

    map: Path
    trajectory: Path | None
    config: dict[str, Any]

    def digest(self) -> str:
        """A hash of all that a build reads."""
        digest = hashlib.sha256(json.dumps(self.config, sort_keys=True).encode())
        for path in (self.map, self.trajectory):
            digest.update(b"" if path is None else path.read_bytes())
        return digest.hexdigest()


@dataclass(frozen=True)
class Built:
    """A version, and the processor seconds of each stage of its build."""

    version: Path
    cpu_s: dict[str, float]


def built(tree: Tree, source: Source, kept: Path) -> Built:
    """Build from nothing, or find what the same code built from the same source before."""
    key = hashlib.sha256(f"{tree.code_digest()} {source.digest()}".encode()).hexdigest()
    work = kept / key[:24]
    costs = work / "cpu_s.json"
    if not costs.exists():  # it is the last that a build writes
        print(f"{tree.name}: builds {source.map.name}", file=sys.stderr, flush=True)
        shutil.rmtree(work, ignore_errors=True)
        work.mkdir(parents=True)
        task = work / "task.json"
        task.write_text(
            json.dumps(
                {
                    "map": str(source.map),
                    "trajectory": None if source.trajectory is None else str(source.trajectory),
                    "config": source.config,
                    "work": str(work),
                }
            )
        )
        command = tree.command("run_build", str(task))
        subprocess.run(command, cwd=ROOT, env=tree.environment(), stdout=sys.stderr, check=True)
    return Built(work / "version", json.loads(costs.read_text()))
