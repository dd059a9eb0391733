"""A build after a part of the map has changed, against a build of the changed map from nothing.

    firstfix-lab rebuilds [--quick] [--changes factory,campus] [--json FILE]

In the factory the goods of one aisle move, in the campus everything above the ground in 20 x 20 m, in a city
of 100,000 templates other houses stand in one block of 25. The build upon the version before is measured as
it is by default, and ``exact``, which gives the version of the build from nothing. Processor time of all
processes, by stage.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

from firstfix.catalog.manifest import FILE_NAME
from firstfix.store.sha256 import sha256_of
from firstfix_builder.rebuild.base_version import REBUILT
from firstfix_lab.checkout import BENCH

from .changes import Change, ChangedMap, RebuiltBlock

WORK = BENCH / "rebuilds"
SIGNED_DISTANCE = {"reconstruct": {"surface": "signed-distance"}}
AISLE = Change("one aisle of the factory", "factory", 0.3, (30.0, 2.6), 0.45, SIGNED_DISTANCE)
HOUSE = Change(
    "20 x 20 m of the campus",
    "campus",
    0.5,
    (20.0, 20.0),
    0.5,
    {**SIGNED_DISTANCE, "level": False, "viewpoints": {"spacing_m": 1.0}},
)
BLOCK = RebuiltBlock("one block of a city", 5, (1, 1), {"level": False, "viewpoints": {"spacing_m": 1.0}})
QUICK = Change(
    "one aisle, coarse",
    "factory",
    0.3,
    (30.0, 2.6),
    0.45,
    {
        **SIGNED_DISTANCE,
        "viewpoints": {"spacing_m": 8.0},
        "self_test": {"queries": 20, "outside": 4},
    },
)


CHANGES = {"factory": AISLE, "campus": HOUSE, "city": BLOCK}


def run(quick: bool, changes: Sequence[str] = ()) -> dict[str, Any]:
    """The figures of each change; the quick suite has the factory alone, with few templates.

    Args:
        changes: names of changes; empty: all.
    """
    asked = (QUICK,) if quick else [CHANGES[name] for name in changes or CHANGES]
    return {"changes": {change.name: measure(change, WORK) for change in asked}}


def measure(change: Change | RebuiltBlock, work: Path) -> dict[str, Any]:
    """Build the map before the change, the changed one upon that, the same exactly, and it from nothing."""
    scratch = work / change.name.replace(" ", "-")
    shutil.rmtree(scratch, ignore_errors=True)
    try:
        changed = change.write(scratch / "map")
        before = _build(changed, changed.before, scratch / "kept")
        shutil.copytree(before.version, scratch / "base")
        shutil.copytree(scratch / "kept", scratch / "exact", copy_function=os.link)
        base, config = scratch / "base", {"base": before.digest}
        upon = _build(changed, changed.after, scratch / "kept", base=base, config=config)
        exact = _build(changed, changed.after, scratch / "exact", base=base, config={**config, "exact": True})
        full = _build(changed, changed.after, scratch / "fresh")
        rebuilt = json.loads((upon.version / FILE_NAME).read_text())["source"].get(REBUILT)
    finally:
        shutil.rmtree(scratch, ignore_errors=True)
    figures = {
        "moved_points": changed.moved,
        "full_cpu_s": full.cpu_s,
        "rebuild_cpu_s": upon.cpu_s,
        "exact_cpu_s": exact.cpu_s,
        "ratio": round(sum(upon.cpu_s.values()) / sum(full.cpu_s.values()), 3),
        "exact_ratio": round(sum(exact.cpu_s.values()) / sum(full.cpu_s.values()), 3),
        "same_version": exact.digest == full.digest,
        "rebuilt": rebuilt,
    }
    print(change.name, figures["ratio"], figures["exact_ratio"], file=sys.stderr, flush=True)
    return figures


@dataclass(frozen=True)
class _Built:
    """A version in its work folder, with the processor seconds of each stage."""

    version: Path
    digest: str
    cpu_s: dict[str, float]


def _build(
    changed: ChangedMap,
    source: Path,
    work: Path,
    *,
    base: Path | None = None,
    config: Mapping[str, Any] = MappingProxyType({}),
) -> _Built:
    """Build in a process of its own.

    Args:
        base: folder of the version before.
        config: beside that of the change.
    """
    work.mkdir(parents=True, exist_ok=True)
    task = work / "task.json"
    asked = {
        "map": str(source),
        "trajectory": None if changed.trajectory is None else str(changed.trajectory),
        "base": None if base is None else str(base),
        "config": {**changed.config, **config},
        "work": str(work),
    }
    task.unlink(missing_ok=True)  # it may be a link
    (work / "cpu_s.json").unlink(missing_ok=True)
    task.write_text(json.dumps(asked))
    command = [sys.executable, "-m", "firstfix_lab.suites.beside.run_build", str(task)]
    subprocess.run(command, stdout=sys.stderr, check=True)
    version = work / "version"
    return _Built(version, sha256_of(version / FILE_NAME), json.loads((work / "cpu_s.json").read_text()))
