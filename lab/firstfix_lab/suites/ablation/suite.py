"""The default method with each of its parts taken out alone: the same scans, asked in turns in one process.

    firstfix-lab ablation [--quick] [--sets hall,yard] [--json FILE]

The scans are the held-out ones of the real sets, at seeded yaws, and those of the simulated worlds of the
robust suite with everything wrong at once. Leaves ``report.md`` in ``build/bench/ablation`` (the quick suite:
in ``quick`` below it). Parts that change the build are not taken out here.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np

from firstfix.engine.index import MapIndex
from firstfix.scan.scan import Scan
from firstfix.scan_file import read_scan_file
from firstfix.transform import Matrix
from firstfix_builder.execution.stage_cache import StageCache
from firstfix_cli.poses_csv import read_poses_csv
from firstfix_lab.checkout import BENCH
from tests.recorded_data import DATASETS, HALL, Dataset

from ...common.asked import Asked, figures_of
from ...common.by_dataset import Figures, measure_each
from ...common.worlds import WORLDS, BenchWorld
from ...evaluation.outcome import turned
from ..real.suite import build
from ..robust.cases import CASES
from ..robust.queries import queries_of
from ..robust.suite import WORK as ROBUST_WORK
from ..robust.versions import Versions
from .parts import PARTS
from .report import report

WORK = BENCH / "ablation"
SEED = 5
YAWS = 5  # of each real scan
SCANS = 60  # of each world
CASE = next(case for case in CASES if case.name == "all at once")
Query = tuple[Scan, Matrix]  # T_map_sensor


def run(quick: bool, sets: Sequence[str] = ()) -> dict[str, Any]:
    """Figures by set and by part; the quick suite has the hall alone, at one yaw.

    Args:
        sets: names of real sets; empty: all, and the worlds.
    """
    yaws, work = (1, WORK / "quick") if quick else (YAWS, WORK)

    def measure_real(dataset: Dataset, folder: Path) -> Figures:
        converted = dataset.converted(folder)
        _, version = build(converted, folder)
        return measure(dataset.name, MapIndex.load(version), list(turned_scans(converted, folder, yaws)))

    figures = measure_each((HALL,) if quick else DATASETS, sets, measure_real)
    if not quick and not sets:
        for world in WORLDS:
            if not world.large:
                figures[world.name] = world.missing or _measure_world(world)
    work.mkdir(parents=True, exist_ok=True)
    (work / "report.md").write_text(report(figures))
    return {"seed": SEED, "sets": figures}


def measure(name: str, index: MapIndex, queries: Iterable[Query]) -> Figures:
    """Ask every scan once with the whole method and once without each part, in a seeded order.

    ``ms`` of the figures is processor time. Who is asked first reads a place's part of the map into memory.
    """
    rng = np.random.default_rng(SEED)
    localizers = {part.name: part.localizer(index) for part in PARTS}
    answers: dict[str, list[Asked]] = {part.name: [] for part in PARTS}
    for number, (scan, T_map_sensor) in enumerate(queries):
        for part in rng.permutation(np.array(PARTS, object)):
            began = time.process_time()
            answer = localizers[part.name].localize(scan, part.options)
            ms = 1e3 * (time.process_time() - began)
            asked = Asked(str(number), part.name, "estimated", {"truth": T_map_sensor}, answer, ms)
            answers[part.name].append(asked)
    found = {
        part: figures_of(asked) | {"cpu_ms": sum(one.ms for one in asked)}
        for part, asked in answers.items()
        if asked
    }
    print(name, {part: one["against"]["truth"] for part, one in found.items()}, file=sys.stderr, flush=True)
    return found


def turned_scans(dataset: Dataset, work: Path, yaws: int) -> Iterator[Query]:
    """The held-out scans of a real set, each at seeded yaws."""
    rng = np.random.default_rng(SEED)
    for row in read_poses_csv(dataset.write_queries(work / "truth.csv")):
        scan = read_scan_file(row.path)
        if row.T_map_sensor is not None:
            for yaw_rad in rng.uniform(-np.pi, np.pi, yaws):
                yield turned(scan, row.T_map_sensor, float(yaw_rad))


def _measure_world(world: BenchWorld) -> Figures:
    files = world.make(StageCache(ROBUST_WORK))
    versions = Versions(world, files, ROBUST_WORK / world.name)
    index = versions.localizer(None).index
    rng = np.random.default_rng([SEED, crc32(world.name.encode())])
    asked = queries_of(CASE, index, versions.sensor(None), files, (), SCANS, rng)
    return measure(world.name, index, [(scan, T) for scan, T in asked if T is not None])
