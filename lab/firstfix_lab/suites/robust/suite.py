"""Every world through every case, a process a world.

    firstfix-lab robust [--quick] [--json FILE]
    firstfix-lab robust_parts --world factory --case "all at once" --queries 50

A run goes on where one of the same program was interrupted, case by case. Leaves ``report.md``,
``figures.json``, ``outcomes.csv`` (one row a query) and each world's part of them in
``build/bench/robust`` (the quick suite: in ``quick`` below it).
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from itertools import groupby
from multiprocessing import get_context
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np

from firstfix.store.sha256 import sha256_of
from firstfix_builder.execution.source_hash import source_hash
from firstfix_builder.execution.stage_cache import StageCache
from firstfix_lab.checkout import BENCH

from ...common.worlds import WORLDS, WORLDS_SOURCE, BenchWorld, Scenery, WorldFiles
from .cases import CASES, FULL, QUICK, Case, Sizes
from .figures import bars_of, figures_of
from .outcome import Outcome, ask
from .parts import Part, write_outcomes
from .queries import queries_of
from .report import report
from .sensors import asking_sensors, template_sensor
from .versions import Versions

WORK = BENCH / "robust"
SEED = 4
SUITE_SOURCE = {path.name: sha256_of(path) for path in sorted(Path(__file__).parent.glob("*.py"))}


def run(quick: bool) -> dict[str, Any]:
    """All worlds but the large ones. The quick suite is the warehouse alone, and anew each time."""
    if quick:
        return measure(WORLDS[:1], CASES, QUICK, WORK / "quick", others=WORLDS[:4])
    worlds = [world for world in WORLDS if not world.large]
    measure_in_processes(worlds, CASES, FULL, WORK, others=worlds, processes=os.cpu_count() or 1)
    return summarize(worlds, WORK)


def measure(
    worlds: Sequence[BenchWorld],
    cases: Sequence[Case],
    sizes: Sizes,
    work: Path,
    others: Sequence[BenchWorld],
) -> dict[str, Any]:
    """Run the cases in every world, one after the other, and return the figures of them all.

    Args:
        others: worlds whose scans are outside the map, where they are another place.
    """
    for world in worlds:
        if world.missing is None:
            measure_world(world, cases, sizes, work, others, resume=False)
    return summarize(worlds, work)


def measure_in_processes(
    worlds: Sequence[BenchWorld],
    cases: Sequence[Case],
    sizes: Sizes,
    work: Path,
    others: Sequence[BenchWorld],
    processes: int,
    resume: bool = True,
) -> None:
    """Run the cases, as many worlds at a time as there are processes. The worlds are those of ``WORLDS``.

    Args:
        resume: as of ``measure_world``.
    """
    tasks = [world.name for world in worlds if world.missing is None]
    names = [world.name for world in others]
    with ProcessPoolExecutor(processes, mp_context=get_context("spawn"), max_tasks_per_child=1) as pool:
        # the smallest worlds are listed first, and are best left to the end
        running = [
            pool.submit(_measure_named, name, cases, sizes, work, names, resume) for name in reversed(tasks)
        ]
        for one in running:
            one.result()


def measure_world(
    world: BenchWorld,
    cases: Sequence[Case],
    sizes: Sizes,
    work: Path,
    others: Sequence[BenchWorld],
    resume: bool,
) -> Part:
    """Every query's outcome, kept as the world's part after each case.

    Args:
        resume: leave out cases that were measured under the same conditions.
    """
    wanted = _conditions(cases, sizes, others)
    kept = Part.load(work / "parts", world.name) if resume else None
    part = kept if kept is not None and kept.conditions == wanted else Part(world.name, conditions=wanted)
    if part.is_whole:
        return part
    began, cache = time.perf_counter(), StageCache(work)
    files = world.make(cache)
    abroad = [o.make(cache).map for o in others if o.missing is None and o.place != world.place]
    versions = Versions(world, files, work / world.name)
    for case in cases[len(part.cases) :]:
        found = list(_outcomes(world, case, sizes.of(case), files, abroad, versions))
        if found:
            print(world.name, case.name, figures_of(found), file=sys.stderr, flush=True)
        now = time.perf_counter()
        part = part.with_case(case.name, found, versions.templates, round(now - began, 1))
        part.save(work / "parts")
        began = now
    return part


def summarize(worlds: Sequence[BenchWorld], work: Path) -> dict[str, Any]:
    """Figures of the worlds' parts, which are kept as the report. A world without a part is left out."""
    figures: dict[str, Any] = {"machine": {"cpus": os.cpu_count()}, "seed": SEED, "worlds": {}}
    everything: list[Outcome] = []
    for world in worlds:
        part = Part.load(work / "parts", world.name)
        if world.missing is not None:
            figures["worlds"][world.name] = f"skipped: {world.missing}"
        elif part is not None:
            figures["worlds"][world.name] = _of_part(part)
            everything += part.outcomes
    figures["bars"] = bars_of(everything) if everything else None
    figures["total"] = _totals(everything)
    figures["sensors"] = _by(everything, lambda o: o.sensor)
    figures["pairs"] = _by(
        [o for o in everything if o.templates != o.sensor], lambda o: f"{o.sensor} asks {o.templates}"
    )
    write_outcomes(work / "outcomes.csv", everything)
    (work / "figures.json").write_text(json.dumps(figures, indent=1) + "\n")
    (work / "report.md").write_text(report(figures))
    return figures


def _measure_named(
    name: str, cases: Sequence[Case], sizes: Sizes, work: Path, others: Sequence[str], resume: bool
) -> None:
    by_name = {world.name: world for world in WORLDS}
    measure_world(by_name[name], cases, sizes, work, [by_name[other] for other in others], resume)


def _outcomes(
    world: BenchWorld,
    case: Case,
    count: int,
    files: WorldFiles,
    abroad: Sequence[Scenery],
    versions: Versions,
) -> Iterable[Outcome]:
    templates = template_sensor(case, world)
    localizer, made_for = versions.localizer(templates), versions.sensor(templates).name
    for sensor, share in asking_sensors(case, world, count):
        model = versions.sensor(sensor)
        seed = [SEED, *(crc32(text.encode()) for text in (world.name, case.name, model.name))]
        rng = np.random.default_rng(seed)
        queries = queries_of(case, localizer.index, model, files, abroad, share, rng)
        if queries:
            localizer.localize(queries[0][0])  # the first pays for what is loaded late
        for scan, T_map_sensor in queries:
            yield ask(localizer, scan, T_map_sensor, world.name, case.name, made_for, model.name)


def _conditions(cases: Sequence[Case], sizes: Sizes, others: Sequence[BenchWorld]) -> dict[str, Any]:
    return {
        "program": source_hash(),
        "worlds": WORLDS_SOURCE,
        "suite": SUITE_SOURCE,
        "cases": [case.name for case in cases],
        "sizes": vars(sizes),
        "others": [world.name for world in others],
    }


def _of_part(part: Part) -> dict[str, Any]:
    by_case = {case: figures_of(list(rows)) for case, rows in groupby(part.outcomes, lambda o: o.case)}
    return {
        "templates": part.templates,
        "seconds": part.seconds,
        "bars": bars_of(part.outcomes),
        "cases": by_case,
    }


def _totals(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    parts = {
        "all at once": [o for o in outcomes if o.case == "all at once"],
        "in the map": [o for o in outcomes if o.inside],
        "outside the map": [o for o in outcomes if not o.inside],
        "everything": outcomes,
    }
    return {name: figures_of(part) for name, part in parts.items() if part}


def _by(outcomes: Sequence[Outcome], key: Callable[[Outcome], str]) -> dict[str, Any]:
    """Bars of the map's scans, by what the key says of them."""
    inside = sorted((o for o in outcomes if o.inside), key=key)
    return {name: bars_of(list(rows)) for name, rows in groupby(inside, key)}
