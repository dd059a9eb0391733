"""Fits the prior of ``firstfix.engine.ranking`` and checks it in worlds that it was not fitted to.

    firstfix-lab calibration [--quick] [--json FILE]
    firstfix-lab calibration_parts --work DIR --scans 24 [--world NAME ...] [--again] [--json FILE]

In every world of ``FITTED_WORLDS`` scans are simulated and localized with the prior in use. The places that
the engine finds are kept in DIR/WORLD/cases.pkl. ``--again`` asks anew: do so when the engine has changed.

Of the worlds of the robust suite, the project's own have other seeds here, and so other layouts. Some maps
are meshes of everything. Others are the clouds of a simulated mapping run, which missed surfaces: there the
world has more than the map. On another day some things have left: then it has less. Scans of a world with
another seed are of a building of the same kind that is not in the map.

Change ``Calibration``'s defaults to the printed ones, then run it again: what the prior accepts at once is
not searched for further, so that the cases depend on it a little.
"""

from __future__ import annotations

import os
import pickle
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from firstfix.builds.config import BuildConfig
from firstfix.engine.calibration import Calibration
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer
from firstfix_builder.execution.stage_cache import StageCache
from firstfix_builder.pipeline import build_version
from firstfix_lab.checkout import BENCH

from ...common.worlds import BenchWorld, own_world, shared_world
from .cases import SEED, Case, cases_of
from .fit import Judged, defaults_of, figures, fit, leave_one_out, support_weights

WORK = BENCH / "calibration"
SCANS, QUICK_SCANS = 24, 8
_UNTESTED = {"self_test": {"queries": 0, "outside": 0}, "viewpoints": {"spacing_m": 1.0}}


def _own(kind: str, seed: int, mapped: bool) -> BenchWorld:
    world = own_world(kind, mapped=mapped, seed=seed, look_alike_seed=seed + 100)
    return replace(world, name=f"{kind}_{seed}_{'cloud' if mapped else 'mesh'}")


FITTED_WORLDS = tuple(
    replace(world, config=world.config | _UNTESTED)
    for world in (
        shared_world("warehouse_aws_small"),
        shared_world("hospital_aws_1floor"),
        shared_world("office_willow_garage"),
        shared_world("office_clearpath", changed="office_construction_clearpath"),
        _own("factory", 11, mapped=True),
        _own("office", 11, mapped=False),
        _own("office", 12, mapped=True),
        _own("campus", 11, mapped=False),
        _own("campus", 12, mapped=True),
    )
)


def run(quick: bool) -> dict[str, Any]:
    """The quick suite has a third of the scans, of two worlds."""
    worlds = FITTED_WORLDS[:2] if quick else FITTED_WORLDS
    return measure(worlds, QUICK_SCANS if quick else SCANS, WORK, again=True)


def measure(worlds: Sequence[BenchWorld], scans: int, work: Path, *, again: bool) -> dict[str, Any]:
    """Fit the prior and return its defaults and figures.

    Args:
        scans: of each kind in each scenery of a world.
        work: folder of versions and cases.
        again: ask the engine again where cases are there already.
    """
    began = time.process_time()
    there = [world for world in worlds if world.missing is None]
    cases = {world.name: _cases(world, scans, work / world.name, again) for world in there}
    judged = {name: [Judged.of(case) for case in own if case.places] for name, own in cases.items()}
    everything = [one for own in judged.values() for one in own]
    fitted = fit(everything)
    place_of = {world.name: world.place for world in there}
    several = len(set(place_of.values())) > 1
    return {
        "machine": {"cpus": os.cpu_count()},
        "seed": SEED,
        "scans": scans,
        "skipped": {world.name: world.missing for world in worlds if world.missing is not None},
        "defaults": defaults_of(fitted),
        "left_out": leave_one_out(judged, place_of) if several else None,
        "fitted": figures(everything, fitted),
        "right_first_by_support_weights": support_weights(
            {name: [one.case for one in own] for name, own in judged.items()}
        )[:8],
        "cpu_s": round(time.process_time() - began, 1),
    }


def _cases(world: BenchWorld, scans: int, folder: Path, again: bool) -> list[Case]:
    """The cases of a world, from the disk or asked now."""
    kept = folder / "cases.pkl"
    if kept.exists() and not again:
        found: list[Case] = pickle.loads(kept.read_bytes())
        return found
    folder.mkdir(parents=True, exist_ok=True)
    files, config = world.make(StageCache(folder)), BuildConfig.parse(world.config)
    built = build_version(files.source, config, folder, trajectory=files.map.trajectory)
    localizer = Localizer(MapIndex.load(built.directory, Calibration()))
    found = cases_of(world, files, localizer, scans)
    kept.write_bytes(pickle.dumps(found))
    print(world.name, len(found), "cases", file=sys.stderr, flush=True)
    return found
