"""A build after a part of the map has changed, against a build of the changed map from nothing.

    firstfix-lab rebuilds [--quick] [--json FILE]

In the factory the goods of one aisle move, in the campus everything above the ground in 20 x 20 m. Both
builds give the same version, so their answers are the same. Processor time of all processes, by stage.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

from firstfix.store.sha256 import sha256_of
from firstfix_lab.checkout import BENCH

from .changes import Change, ChangedMap, write_changed_map

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


def run(quick: bool) -> dict[str, Any]:
    """The figures of each change; the quick suite has the factory alone, with few templates."""
    changes = (QUICK,) if quick else (AISLE, HOUSE)
    return {"changes": {change.name: measure(change, WORK) for change in changes}}


def measure(change: Change, work: Path) -> dict[str, Any]:
    """Build the map before the change, the changed one upon that, and the changed one from nothing."""
    scratch = work / change.name.replace(" ", "-")
    shutil.rmtree(scratch, ignore_errors=True)
    try:
        changed = write_changed_map(change, scratch / "map")
        _build(changed, changed.before, scratch / "kept")
        rebuild_cpu_s, digest = _build(changed, changed.after, scratch / "kept")
        full_cpu_s, from_nothing = _build(changed, changed.after, scratch / "fresh")
    finally:
        shutil.rmtree(scratch, ignore_errors=True)
    full, rebuild = sum(full_cpu_s.values()), sum(rebuild_cpu_s.values())
    figures = {
        "moved_points": changed.moved,
        "full_cpu_s": full_cpu_s,
        "rebuild_cpu_s": rebuild_cpu_s,
        "ratio": round(rebuild / full, 3),
        "same_version": digest == from_nothing,
    }
    print(change.name, figures["ratio"], file=sys.stderr, flush=True)
    return figures


def _build(changed: ChangedMap, source: Path, work: Path) -> tuple[dict[str, float], str]:
    """Build in a process of its own. Returns each stage's processor seconds and the digest."""
    work.mkdir(parents=True, exist_ok=True)
    task = work / "task.json"
    asked = {
        "map": str(source),
        "trajectory": str(changed.trajectory),
        "config": changed.config,
        "work": str(work),
    }
    task.write_text(json.dumps(asked))
    command = [sys.executable, "-m", "firstfix_lab.suites.beside.run_build", str(task)]
    subprocess.run(command, stdout=sys.stderr, check=True)
    digest = sha256_of(work / "version" / "manifest.json")
    return json.loads((work / "cpu_s.json").read_text()), digest
