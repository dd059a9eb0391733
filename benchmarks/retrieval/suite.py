"""Recall of each piece of the default method, in several worlds.

    python -m benchmarks.run retrieval [--quick] [--json FILE]
    python -m benchmarks.retrieval --world campus --spacing 0.45 --piece keys

Leaves ``report.md`` and ``figures.json`` in ``build/bench/retrieval``.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Iterable, Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from firstfix.builds.config import BuildConfig
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer
from firstfix_builder.execution.stage_cache import StageCache
from firstfix_builder.pipeline import build_version

from ..common.worlds import WORLDS, BenchWorld
from .described_world import DescribedWorld
from .pieces import LEARN_SEED, SEED, Pieces, Sizes
from .report import report
from .trial import Row

WORK = Path(__file__).parents[2] / "build" / "bench" / "retrieval"
NAMES = ("office_willow_garage", "hospital_aws_1floor", "factory")
QUICK_NAME = "office_clearpath"
PIECES = ("keys", "cells", "gravity", "spacing", "reranking", "sensors")
QUICK_PIECES = ("keys",)
FULL, QUICK = Sizes(), Sizes(queries=60, taught=400, registered=0)
UNTESTED = {"queries": 0, "outside": 0}  # of the build's own self-test: nothing here asks for a probability


def run(quick: bool) -> dict[str, Any]:
    """The quick suite has the keys alone, in one small office."""
    names, pieces, sizes = ((QUICK_NAME,), QUICK_PIECES, QUICK) if quick else (NAMES, PIECES, FULL)
    return measure([world for world in WORLDS if world.name in names], pieces, sizes, WORK)


def measure(
    worlds: Iterable[BenchWorld],
    pieces: Sequence[str],
    sizes: Sizes,
    work: Path,
    spacing_m: float | None = None,
) -> dict[str, Any]:
    """Measures the chosen pieces in every world.

    Args:
        pieces: names in PIECES, the rows of the report in their order.
        spacing_m: of the templates; None: as the builder chooses.
    """
    figures: dict[str, Any] = {"machine": {"cpus": os.cpu_count()}, "seeds": [SEED, LEARN_SEED]}
    figures |= {"sizes": vars(sizes), "worlds": {}}
    for world in worlds:
        if world.missing is not None:
            figures["worlds"][world.name] = f"skipped: {world.missing}"
            continue
        for so_far in measure_world(world, pieces, sizes, work, spacing_m):
            figures["worlds"][world.name] = so_far
            (work / "figures.json").write_text(json.dumps(figures, indent=1) + "\n")
    (work / "report.md").write_text(report(figures))
    return figures


def measure_world(
    world: BenchWorld, pieces: Sequence[str], sizes: Sizes, work: Path, spacing_m: float | None
) -> Iterator[dict[str, Any]]:
    """All that is measured of a world, piece by piece: a run takes a while."""
    scenery = world.make(StageCache(work)).map
    simulator = scenery.simulator()
    sensor = BuildConfig.parse(world.config).sensor_model

    @cache
    def localizer(spacing_m: float | None) -> tuple[Localizer, DescribedWorld]:
        chosen = world.config | {"self_test": UNTESTED, "viewpoints": {"spacing_m": spacing_m}}
        built = build_version(
            scenery.mesh,
            BuildConfig.parse(chosen),
            work / world.name / f"{spacing_m}",
            trajectory=scenery.trajectory,
        )
        found = Localizer(MapIndex.load(built.directory))
        return found, DescribedWorld.of(found.index, simulator)

    described = localizer(spacing_m)[1]

    def of_spacing(wanted_m: float) -> tuple[Localizer, DescribedWorld]:
        return localizer(spacing_m if wanted_m == described.spacing_m else wanted_m)

    table = Pieces(described, sensor, of_spacing, sizes)
    figures = {
        "templates": len(described.position_m),
        "spacing_m": described.spacing_m,
        "sensor": sensor.name,
    }
    rows: list[Row] = []
    for name in pieces:
        began = time.monotonic()
        rows += getattr(table, name)()
        print(world.name, name, f"{time.monotonic() - began:.0f} s", file=sys.stderr, flush=True)
        yield {**figures, "rows": rows}
