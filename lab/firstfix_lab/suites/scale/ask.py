"""One process that loads a version and asks it: ``... suites.scale.ask VERSION SCANS``, to JSON.

Alone, so that what it takes is what a worker takes.
"""

from __future__ import annotations

import json
import os
import resource
import statistics
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firstfix.answer.localization import Localization, Verdict
from firstfix.answer.options import LocalizeOptions
from firstfix.answer.prior import Prior
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer
from firstfix.scan.scan import Scan
from firstfix.transform import Matrix, pose_error

from .queries import read_scans

RIGHT_DEG = 10.0
PRIOR_M, PRIOR_OFF_M = 30.0, 10.0
KEPT_M = (0.05, 0.2, 1.0)


def main(version: Path, scans: Path) -> dict[str, Any]:
    """The figures, in the order in which they are taken."""
    asked, T_map_sensor = read_scans(scans)
    drop_pages(version)
    figures: dict[str, Any] = {"before_load": _memory_mb()}
    began = time.perf_counter()
    localizer = Localizer(MapIndex.load(version))
    figures["load_ms"] = _ms_since(began)
    figures["loaded"] = _memory_mb()
    began = time.perf_counter()
    localizer.localize(asked[0])
    figures["first_query_ms"] = _ms_since(began)
    figures["major_faults"] = resource.getrusage(resource.RUSAGE_SELF).ru_majflt
    for scan in asked:  # reads the pages that are asked for below
        localizer.localize(scan)
    figures["after_queries"] = _memory_mb()
    anywhere = [LocalizeOptions()] * len(asked)
    off = np.random.default_rng(1).uniform(-PRIOR_OFF_M, PRIOR_OFF_M, (len(asked), 3)) * [1, 1, 0]
    near = [LocalizeOptions(prior=Prior(at, PRIOR_M)) for at in T_map_sensor[:, :3, 3] + off]
    for name, options in (("anywhere", anywhere), ("with_prior", near)):
        figures[name] = _asked(localizer, asked, T_map_sensor, options)
    return figures


def drop_pages(version: Path) -> None:
    """Ask the kernel to forget the files: it does, of those that no process has mapped."""
    for path in version.iterdir():
        handle = os.open(path, os.O_RDONLY)
        os.fsync(handle)
        os.posix_fadvise(handle, 0, 0, os.POSIX_FADV_DONTNEED)
        os.close(handle)


def _asked(
    localizer: Localizer,
    scans: list[Scan],
    T_map_sensor: NDArray[np.float64],
    options: list[LocalizeOptions],
) -> dict[str, Any]:
    milliseconds, answers = [], []
    for scan, how in zip(scans, options, strict=True):
        began = time.perf_counter()
        answers.append(localizer.localize(scan, how))
        milliseconds.append(1e3 * (time.perf_counter() - began))
    errors = np.array([_error(one, T) for one, T in zip(answers, T_map_sensor, strict=True)])
    localized = np.array([one.verdict is Verdict.LOCALIZED for one in answers])
    stages = {stage for one in answers for stage in one.timings_ms}
    return {
        "queries": len(scans),
        "median_ms": round(statistics.median(milliseconds), 1),
        "p99_ms": round(float(np.percentile(milliseconds, 99)), 1),
        "stages_ms": {
            stage: round(statistics.median(one.timings_ms.get(stage, 0.0) for one in answers), 2)
            for stage in sorted(stages)
        },
        "success": {f"{limit}m": round(float((errors <= limit).mean()), 4) for limit in KEPT_M},
        "localized": round(float(localized.mean()), 4),
        "false": int((localized & ~(errors <= 1)).sum()),
    }


def _error(answer: Localization, T: Matrix) -> float:
    """Metres of the best hypothesis; infinite where there is none or it is turned."""
    if not answer.hypotheses:
        return float("inf")
    off_m, off_deg = pose_error(T, answer.hypotheses[0].T_map_sensor)
    return off_m if off_deg <= RIGHT_DEG else float("inf")


def _memory_mb() -> dict[str, int]:
    """Memory of this process (Linux): its own, and the file pages that it has touched."""
    lines = Path("/proc/self/smaps_rollup").read_text().splitlines()[1:]
    kb = {line.split(":")[0]: int(line.split()[1]) for line in lines}
    return {"own": round(kb["Pss_Anon"] / 1e3), "resident": round(kb["Rss"] / 1e3)}


def _ms_since(began: float) -> float:
    return round(1e3 * (time.perf_counter() - began), 1)


if __name__ == "__main__":
    json.dump(main(Path(sys.argv[1]), Path(sys.argv[2])), sys.stdout)
