"""Koide's Hard Point Cloud Localization Dataset: single scans of a Mid-360 on maps of others.

    python -m benchmarks.run koide --data FOLDER [--scans N] [--json FILE]

Leaves ``report.md`` in ``build/bench/koide``. README.md says how to get the data.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firstfix.answer.localization import Localization, Reason, Verdict
from firstfix.answer.options import LocalizeOptions
from firstfix.builds.config import BuildConfig
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer
from firstfix.errors import InvalidScan
from firstfix_builder.pipeline import build_version

from ..common.asked import Asked, figures_of
from .drawn_scans import DrawnScan, draw_scans
from .layout import RECORDINGS, Files, Recording, TruePoses, files_of
from .report import report

WORK = Path(__file__).parents[2] / "build" / "bench" / "koide"
SEED = 1
SCANS, QUICK_SCANS = 200, 20
CONFIG = {"sensor": {"preset": "mid-360", "mount_height_m": 1.2}}  # carried by hand
SUCCESS = {"0.2m_1deg": (0.2, 1.0), "0.5m_5deg": (0.5, 5.0), "1m_5deg": (1.0, 5.0), "2m_10deg": (2.0, 10.0)}


def run(quick: bool, data: Path | None = None, scans: int = SCANS) -> dict[str, Any]:
    """The quick suite asks fewer scans of each recording.

    Args:
        data: folder of the downloaded data set.
        scans: of each recording.
    """
    figures: dict[str, Any] = {"machine": {"cpus": os.cpu_count()}, "seed": SEED, "config": CONFIG}
    if data is None:
        return figures | {"skipped": "no --data FOLDER says where the data set is"}
    figures |= measure(data, QUICK_SCANS if quick else scans, CONFIG)
    WORK.mkdir(parents=True, exist_ok=True)
    (WORK / "report.md").write_text(report(figures))
    return figures


def measure(data: Path, count: int, config: dict[str, Any]) -> dict[str, Any]:
    """Builds each map that has recordings, and asks scans of these.

    Args:
        count: scans of each recording.
        config: of the builds.
    """
    found = {recording: files_of(data, recording) for recording in RECORDINGS}
    figures: dict[str, Any] = {"maps": {}, "recordings": {}}
    every: list[Asked] = []
    for map_name in dict.fromkeys(recording.map_name for recording in RECORDINGS):
        there = {
            r: files for r, files in found.items() if r.map_name == map_name and isinstance(files, Files)
        }
        if not there:
            continue
        with tempfile.TemporaryDirectory(prefix="firstfix-koide-") as folder:
            localizer, figures["maps"][map_name] = _built(
                next(iter(there.values())).map_path, config, Path(folder)
            )
            for recording, files in there.items():
                asked = _ask_all(localizer, recording, files, count)
                every += asked
                figures["recordings"][recording.name] = _by_gravity(asked)
                print(recording.name, figures["recordings"][recording.name], file=sys.stderr, flush=True)
    missing = {r.name: files for r, files in found.items() if isinstance(files, str)}
    figures["recordings"] |= missing
    return figures | ({"total": _by_gravity(every)} if every else {})


def _built(map_path: Path, config: dict[str, Any], work: Path) -> tuple[Localizer, dict[str, Any]]:
    began = time.monotonic()
    built = build_version(map_path, BuildConfig.parse(config), work)
    build_s = round(time.monotonic() - began, 1)
    localizer = Localizer(MapIndex.load(built.directory))
    return localizer, {"build_s": build_s, "templates": len(localizer.index.cascade.templates.position_m)}


def _ask_all(localizer: Localizer, recording: Recording, files: Files, count: int) -> list[Asked]:
    """Every drawn scan is asked with the gravity that the engine estimates, and with the IMU's."""
    scans = draw_scans(files.bags, TruePoses.read(files.poses), count, SEED)
    asked = []
    for number, one in enumerate(scans):
        if number == 0:
            _ask(localizer, one, None)  # the first query pays for what is loaded late
        for gravity, down in (("estimated", None), ("given", one.gravity)):
            began = time.perf_counter()
            answer = _ask(localizer, one, down)
            ms = 1e3 * (time.perf_counter() - began)
            name = f"{recording.name} {one.cloud.header.stamp}"
            asked.append(Asked(name, recording.name, gravity, {"truth": one.T_map_sensor}, answer, ms))
    return asked


def _ask(localizer: Localizer, one: DrawnScan, gravity: NDArray[np.float64] | None) -> Localization:
    try:
        scan = one.cloud.scan()
    except InvalidScan:  # a covered sensor sees nothing
        return Localization(Verdict.REJECTED, (Reason.TOO_FEW_POINTS,))
    return localizer.localize(scan, LocalizeOptions(gravity=gravity))


def _by_gravity(asked: Sequence[Asked]) -> dict[str, Any]:
    return {
        gravity: {
            **figures_of(group),
            "success": _success(group),
            "mean_ms": round(float(np.mean([a.ms for a in group])), 2),
        }
        for gravity in ("estimated", "given")
        if (group := [a for a in asked if a.gravity == gravity])
    }


def _success(asked: Sequence[Asked]) -> dict[str, float]:
    """Shares of all scans that are localized within so many metres and degrees of the whole rotation."""
    errors = [error for a in asked if (error := a.answer_error("truth")) is not None]
    return {
        name: round(sum(m <= most_m and deg <= most_deg for m, deg in errors) / len(asked), 4)
        for name, (most_m, most_deg) in SUCCESS.items()
    }
