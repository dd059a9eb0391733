"""Asks scans of simulated worlds in each encoding, and tells how far the probabilities are apart.

    firstfix-lab encodings [--world NAME ...] [--places 40] [--seed N] [--work DIR] [--json FILE]

At each place the scan is asked whole and cut to what lies near the sensor, so that many answers are
ambiguous. Scans are disturbed as in ``robust`` with all at once. Versions are built as a user would build
them, and kept below DIR.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np

from firstfix.builds.config import BuildConfig
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer
from firstfix_builder.execution.stage_cache import StageCache
from firstfix_builder.pipeline import build_version
from firstfix_lab.checkout import BENCH

from ...common.worlds import BenchWorld, own_world, shared_world
from ..real.degrade import within
from ..robust.cases import ALL, Case
from ..robust.queries import queries_of
from .forms import Differences, Pair, differences_of, pairs_of, told

WORK = BENCH / "encodings"
SPACING_M = {"viewpoints": {"spacing_m": 1.0}}  # a quicker build
WORLDS = {
    "factory": own_world("factory"),
    "office": own_world("office", seed=21, look_alike_seed=121),  # a seed of no other suite
    "hospital": shared_world("hospital_aws_1floor"),
    "willow": shared_world("office_willow_garage"),
}
REACHES_M = (np.inf, 8.0, 6.0, 4.0)
CASE = Case("all at once", ALL)


def measure(world: BenchWorld, places: int, seed: int, work: Path) -> Iterator[Pair]:
    """Build the world's version and ask the scans of some places in it.

    Args:
        work: folder whose stage caches make a second run quick.
    """
    work.mkdir(parents=True, exist_ok=True)
    files = world.make(StageCache(work))
    config = BuildConfig.parse(world.config | SPACING_M)
    built = build_version(files.source, config, work, trajectory=files.map.trajectory)
    localizer = Localizer(MapIndex.load(built.directory), explains=False)
    rng = np.random.default_rng(seed)
    for scan, _ in queries_of(CASE, localizer.index, config.sensor_model, files, [], places, rng):
        for reach_m in REACHES_M:
            near = within(scan, reach_m)
            if len(near):
                yield from pairs_of(localizer, near)


def _plain(found: dict[str, dict[str, Differences]]) -> dict[str, dict[str, dict[str, float]]]:
    return {form: {name: asdict(one) for name, one in rows.items()} for form, rows in found.items()}


def main(argv: Sequence[str]) -> None:
    parser = argparse.ArgumentParser(
        prog="firstfix-lab encodings", description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--world", action="append", choices=list(WORLDS), help="default: all")
    parser.add_argument("--places", type=int, default=40, help="of each world")
    parser.add_argument("--seed", type=int, default=59)
    parser.add_argument("--work", type=Path, default=WORK, metavar="DIR")
    parser.add_argument("--json", type=Path)
    chosen = parser.parse_args(argv)
    figures, everywhere = {}, []
    for name in chosen.world or list(WORLDS):
        world = WORLDS[name]
        if world.missing is not None:
            print(f"{name}: {world.missing}", file=sys.stderr)
            continue
        pairs = list(measure(world, chosen.places, chosen.seed, chosen.work / name))
        everywhere += pairs
        found = differences_of(pairs)
        figures[name] = _plain(found)
        print(f"{name}\n\n{told(found)}\n", flush=True)
    if len(figures) > 1:
        found = differences_of(everywhere)
        figures["all"] = _plain(found)
        print(f"all\n\n{told(found)}")
    if chosen.json is not None:
        chosen.json.write_text(json.dumps(figures, indent=1) + "\n")
