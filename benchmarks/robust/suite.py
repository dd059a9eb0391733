"""Every world through every case.

    python -m benchmarks.run robust [--quick] [--json FILE]
    python -m benchmarks.robust --world factory --case "all at once" --queries 50

Leaves ``report.md``, ``figures.json`` and ``outcomes.csv`` (one row a query) in ``build/bench/robust``.
"""

from __future__ import annotations

import csv
import json
import os
import sys
from collections.abc import Iterable, Sequence
from dataclasses import fields
from itertools import groupby
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np

from firstfix_builder.execution.stage_cache import StageCache

from ..common.worlds import WORLDS, BenchWorld, Scenery
from .cases import CASES, FULL, QUICK, Case, Sizes
from .figures import figures_of
from .outcome import Outcome, ask
from .queries import queries_of
from .report import report
from .versions import Versions

WORK = Path(__file__).parents[2] / "build" / "bench" / "robust"
SEED = 4


def run(quick: bool) -> dict[str, Any]:
    """The quick suite is the warehouse alone."""
    worlds = WORLDS[:1] if quick else WORLDS
    return measure(worlds, CASES, QUICK if quick else FULL, WORK, others=WORLDS[:4] if quick else WORLDS)


def measure(
    worlds: Iterable[BenchWorld],
    cases: Sequence[Case],
    sizes: Sizes,
    work: Path,
    others: Sequence[BenchWorld],
) -> dict[str, Any]:
    """Runs the cases in every world.

    Args:
        others: worlds whose scans are outside the map, where they are another place.
    """
    cache = StageCache(work)
    figures: dict[str, Any] = {"machine": {"cpus": os.cpu_count()}, "seed": SEED, "sizes": vars(sizes)}
    figures["worlds"], outcomes = {}, []
    for world in worlds:
        if world.missing is not None:
            figures["worlds"][world.name] = f"skipped: {world.missing}"
            continue
        abroad = [o.make(cache).map for o in others if o.missing is None and o.place != world.place]
        found, templates = measure_world(world, cases, sizes, cache, work / world.name, abroad)
        outcomes += found
        by_case = {case: figures_of(list(rows)) for case, rows in groupby(found, lambda o: o.case)}
        figures["worlds"][world.name] = {"templates": templates, "cases": by_case}
    figures["total"] = _totals(outcomes)
    _write_outcomes(work / "outcomes.csv", outcomes)
    (work / "figures.json").write_text(json.dumps(figures, indent=1) + "\n")
    (work / "report.md").write_text(report(figures))
    return figures


def measure_world(
    world: BenchWorld,
    cases: Sequence[Case],
    sizes: Sizes,
    cache: StageCache,
    work: Path,
    abroad: Sequence[Scenery],
) -> tuple[list[Outcome], dict[str, int]]:
    """Every query's outcome, case by case, and the number of templates by their sensor."""
    files = world.make(cache)
    versions = Versions(world, files.map, work)
    outcomes = []
    for case in cases:
        localizer = versions.localizer(case.templates)
        rng = np.random.default_rng([SEED, crc32(world.name.encode()), crc32(case.name.encode())])
        queries = queries_of(
            case, localizer.index, versions.sensor(case.queries), files, abroad, sizes.of(case), rng
        )
        if queries:
            localizer.localize(queries[0][0])  # the first pays for what is loaded late
            found = [ask(localizer, scan, T, world.name, case.name) for scan, T in queries]
            print(world.name, case.name, figures_of(found), file=sys.stderr, flush=True)
            outcomes += found
    return outcomes, versions.templates


def _totals(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    parts = {
        "all at once": [o for o in outcomes if o.case == "all at once"],
        "in the map": [o for o in outcomes if o.inside],
        "outside the map": [o for o in outcomes if not o.inside],
        "everything": outcomes,
    }
    return {name: figures_of(part) for name, part in parts.items() if part}


def _write_outcomes(path: Path, outcomes: Sequence[Outcome]) -> None:
    names = [f.name for f in fields(Outcome)]
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(names)
        for outcome in outcomes:
            values = (getattr(outcome, name) for name in names)
            writer.writerow([f"{v:.5g}" if isinstance(v, float) else getattr(v, "value", v) for v in values])
