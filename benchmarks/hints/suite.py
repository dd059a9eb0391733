"""Ambiguous scans in worlds with rooms that look alike: following the hint against moving at random.

    python -m benchmarks.run hints [--quick] [--json FILE]

Every scan has all that goes wrong at once. An ambiguous one is counted as *distinct* if its place is: no
other hypothesis explains the scan as well as the true pose does (``benchmarks.robust``). A scan without a
hint is counted as not resolved. The random move is as long as the hint's, in a direction that is free in the
world.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from firstfix.answer.localization import Verdict
from firstfix.engine.localizer import Localizer
from firstfix.sensor import SensorModel, preset
from firstfix.transform import transform_points
from firstfix_builder.execution.stage_cache import StageCache
from firstfix_builder.simulation.perturb import ScanSimulation
from firstfix_builder.simulation.simulate import Simulator

from ..common.worlds import WORLDS
from ..robust.cases import ALL
from ..robust.outcome import Standing, standing_in
from ..robust.suite import WORK
from ..robust.versions import Versions
from .follow import MOVES, Followed, at_random, by_hint, follow

SEED = 12
NAMES = ("office", "office_willow_garage", "hospital_aws_1floor", "office_clearpath")
QUERIES, SENSOR = 150, "vlp-16"


@dataclass(frozen=True)
class Attempt:
    """One ambiguous scan, followed in both ways.

    Attributes:
        is_distinct: no other place explains the scan as well as the true one.
        has_hint: the answer to the single scan had one.
        hint_ms: time that the hint took.
    """

    is_distinct: bool
    has_hint: bool
    hint_ms: float
    hint: Followed
    random: Followed


def run(quick: bool) -> dict[str, Any]:
    """The quick suite is the small office alone, with half of the scans."""
    names, count = (NAMES[-1:], QUERIES // 2) if quick else (NAMES, QUERIES)
    figures: dict[str, Any] = {"machine": {"cpus": os.cpu_count()}, "seed": SEED, "queries": count}
    every: list[Attempt] = []
    for world in (world for world in WORLDS if world.name in names):
        if world.missing is not None:
            figures[world.name] = f"skipped: {world.missing}"
            continue
        files = world.make(StageCache(WORK))
        localizer = Versions(world, files.map, WORK / world.name).localizer(None)
        found = attempts(localizer, files.map.simulator(), preset(SENSOR), count)
        figures[world.name] = figures_of(found)
        print(world.name, figures[world.name], file=sys.stderr, flush=True)
        every += found
    figures["total"] = figures_of(every)
    return figures


def attempts(localizer: Localizer, simulator: Simulator, sensor: SensorModel, count: int) -> list[Attempt]:
    """Follows the ambiguous ones of so many scans at seeded places of the map."""
    rng, index = np.random.default_rng(SEED), localizer.index
    simulation = ScanSimulation(simulator, sensor, ALL)
    at_m = transform_points(index.T_map_level, np.asarray(index.cascade.templates.position_m, np.float64))
    found = []
    for case in simulation.cases(at_m, index.config.spacing_m, count, rng):
        scan, T_map_sensor = simulation.scan(case), case.T_level_sensor
        answer = localizer.localize(scan)
        if answer.verdict is not Verdict.AMBIGUOUS:
            continue
        seed = int(rng.integers(2**32))
        ends = follow(localizer, simulation, scan, T_map_sensor, answer, by_hint, seed)
        anyhow = at_random(simulation, ends.ways_m, rng)
        random = follow(localizer, simulation, scan, T_map_sensor, answer, anyhow, seed)
        standing = standing_in(localizer, scan, T_map_sensor, answer)
        is_distinct = standing is Standing.DISTINCT
        has_hint, ms = answer.hint is not None, answer.timings_ms["hint"]
        found.append(Attempt(is_distinct, has_hint, ms, ends, random))
    return found


def figures_of(found: Sequence[Attempt]) -> dict[str, Any]:
    """Shares that were resolved, of all and of the distinct scans. A share of nothing is None."""
    distinct = [one for one in found if one.is_distinct]
    ms = [one.hint_ms for one in found]
    return {
        "ambiguous": len(found),
        "with_hint": sum(one.has_hint for one in found),
        "hint_ms": {f"p{q}": round(float(np.percentile(ms, q)), 1) for q in (50, 95)} if ms else None,
        "blocked_ways": sum(one.hint.blocked for one in found),
        **_shares("all", found),
        **_shares("distinct", distinct),
    }


def _shares(name: str, found: Sequence[Attempt]) -> dict[str, Any]:
    told = [one for one in found if one.has_hint]
    return {
        name: {
            "n": len(found),
            "hint": _share([one.hint.is_resolved for one in found]),
            "hint_where_given": _share([one.hint.is_resolved for one in told]),
            "hint_first_move": _share([one.hint.is_resolved and one.hint.moves < MOVES for one in found]),
            "hint_wrong": sum(one.hint.is_wrong for one in found),
            "random": _share([one.random.is_resolved for one in found]),
            "random_where_given": _share([one.random.is_resolved for one in told]),
            "random_wrong": sum(one.random.is_wrong for one in found),
        }
    }


def _share(flags: Sequence[bool]) -> float | None:
    return round(float(np.mean(flags)), 3) if flags else None
