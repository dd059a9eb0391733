"""Fits the prior of ``firstfix.engine.ranking`` and checks it in worlds that it was not fitted to.

    python -m benchmarks.run calibration [--quick] [--json FILE]
    python -m benchmarks.calibration --work DIR --scans 24 [--world NAME ...] [--again] [--json FILE]

In every world of ``worlds.py`` scans are simulated and localized with the prior in use. The places that the
engine finds are kept in DIR/WORLD/cases.pkl. ``--again`` asks anew: do so when the engine has changed. The
built versions in DIR stay, too: remove a world's folder to have it built again.

Change ``Calibration``'s defaults to the printed ones, then run it again: what the prior accepts at once is
not searched for further, so that the cases depend on it a little.
"""

from __future__ import annotations

import os
import pickle
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from firstfix.engine.localizer import Localizer

from .cases import SEED, Case, cases_of
from .fit import Judged, defaults_of, figures, fit, leave_one_out, support_weights
from .worlds import FITTED_WORLDS, FittedWorld

WORK = Path(__file__).parents[2] / "build" / "bench" / "calibration"
SCANS, QUICK_SCANS = 24, 8


def run(quick: bool) -> dict[str, Any]:
    """The quick suite has a third of the scans, of two worlds."""
    worlds = FITTED_WORLDS[:2] if quick else FITTED_WORLDS
    return measure(worlds, QUICK_SCANS if quick else SCANS, WORK, again=True)


def measure(worlds: Sequence[FittedWorld], scans: int, work: Path, *, again: bool) -> dict[str, Any]:
    """Fits the prior and returns its defaults and figures.

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


def _cases(world: FittedWorld, scans: int, folder: Path, again: bool) -> list[Case]:
    """The cases of a world, from the disk or asked now."""
    kept = folder / "cases.pkl"
    if kept.exists() and not again:
        found: list[Case] = pickle.loads(kept.read_bytes())
        return found
    folder.mkdir(parents=True, exist_ok=True)
    localizer = Localizer(world.index(folder))
    found = cases_of(world, world.make(folder), localizer, scans)
    kept.write_bytes(pickle.dumps(found))
    print(world.name, len(found), "cases", file=sys.stderr, flush=True)
    return found
