"""From twenty thousand templates to ten million: what each takes, and how it grows.

firstfix-lab scale [--quick] [--json FILE]
firstfix-lab scale_parts --work DIR [--world NAME] [--json FILE]
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Mapping
from concurrent.futures import ProcessPoolExecutor
from itertools import pairwise
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from firstfix_lab.checkout import BENCH

from .build import Built, build
from .extent import BY_DEFAULT, EXTENTS, QUICK, Extent
from .key_recall import ENGINES, asked_of, exact_recall, key_recall
from .queries import take_scans

WORK = BENCH / "scale"
SCANS, QUICK_SCANS = 200, 12
ALL_ENGINES = 2_000_000  # keys; of more, the engine that `auto` is


def run(quick: bool, work: Path = WORK) -> dict[str, Any]:
    """The quick suite has worlds of a few hundred templates."""
    return measure(
        QUICK if quick else {name: EXTENTS[name] for name in BY_DEFAULT},
        work,
        QUICK_SCANS if quick else SCANS,
    )


def measure(extents: Mapping[str, Extent], work: Path, scans: int) -> dict[str, Any]:
    """Build and ask every world. Finished parts are taken from the work folder."""
    work.mkdir(parents=True, exist_ok=True)
    worlds: dict[str, Any] = {}
    for name, extent in extents.items():
        with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as alone:  # its memory is the build's
            built = alone.submit(build, extent, work).result()
        worlds[name] = _figures(built, work, scans)
        print(name, json.dumps(worlds[name], indent=1), file=sys.stderr, flush=True)
    return {"machine": {"cpus": os.cpu_count()}, "worlds": worlds, "growth": _growth(worlds)}


def _figures(built: Built, work: Path, count: int) -> dict[str, Any]:
    scans = take_scans(built, work, count)
    sizes = {path.name: path.stat().st_size for path in built.version.iterdir()}
    asked = asked_of(built, scans, work)
    few = len(asked.keys) < ALL_ENGINES
    return {
        "templates": len(asked.keys),
        "extent_m": [round(float(side)) for side in np.ptp(asked.position_m[:, :2], axis=0)],
        "version_mb": round(sum(sizes.values()) / 1e6, 1),
        "largest_files_mb": {
            name: round(size / 1e6, 1) for name, size in sorted(sizes.items(), key=lambda e: -e[1])[:6]
        },
        "build": built.took,
        "build_s": round(sum(cost["seconds"] for cost in built.took.values()), 1),
        "build_cpu_s": round(sum(cost["cpu_seconds"] for cost in built.took.values()), 1),
        **_asked_alone(built.version, scans),
        "keys": {
            "exact": exact_recall(asked),
            **{engine: key_recall(asked, engine) for engine in ENGINES[: None if few else 1]},
        },
    }


def _asked_alone(version: Path, scans: Path) -> Any:
    """By a process of its own."""
    command = [sys.executable, "-m", "firstfix_lab.suites.scale.ask", str(version), str(scans)]
    done = subprocess.run(command, stdout=subprocess.PIPE, check=True, text=True)
    return json.loads(done.stdout)


def _growth(worlds: Mapping[str, Any]) -> list[dict[str, Any]]:
    """From each world to the next larger one: by what templates, time, memory and disk are multiplied."""
    rows = list(worlds.items())
    return [
        {
            "from": before,
            "to": after,
            "templates": _ratio(large["templates"], small["templates"]),
            "median": _ratio(large["anywhere"]["median_ms"], small["anywhere"]["median_ms"]),
            "p99": _ratio(large["anywhere"]["p99_ms"], small["anywhere"]["p99_ms"]),
            "version": _ratio(large["version_mb"], small["version_mb"]),
            "own_memory": _ratio(large["after_queries"]["own"], small["after_queries"]["own"]),
            "build_cpu": _ratio(large["build_cpu_s"], small["build_cpu_s"]),
        }
        for (before, small), (after, large) in pairwise(rows)
    ]


def _ratio(large: float, small: float) -> float:
    return round(large / max(small, 1e-9), 2)
