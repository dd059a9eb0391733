"""Real maps and held-out scans: through a running service as they are, and in this process made worse.

The service's figures are success, error, milliseconds and build cost; the degraded ones are those of
``degraded``.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from firstfix.builds.config import BuildConfig
from firstfix.catalog.catalog import Catalog
from firstfix.decode import read_scan_file
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer
from firstfix.scan.scan import Scan
from firstfix.sensor import SensorModel
from firstfix.store.store import Store
from firstfix.transform import Matrix
from firstfix_cli.evaluate import Outcome, outcome_of, random_yaws, report_of, turned
from firstfix_cli.local_service import local_service
from firstfix_cli.poses_csv import PosedScan, read_poses_csv

from ..common.datasets import HALL, STREET, Dataset
from ..common.memory import PeakMemory
from .degrade import every_second_ring, tilted, without_sectors

SEED = 1  # of the yaw that each scan is turned by, and of what degrades it
QUICK = (HALL,)
LOST = 0.3  # of the points, in sectors
TILT_DEG = 5.0
LIMITS = ((0.1, 0.5), (0.2, 1.0))  # m and degrees of the whole rotation


def run(quick: bool) -> dict[str, Any]:
    """The figures of every data set that is there; the quick suite has the hall alone."""
    figures: dict[str, Any] = {"machine": {"cpus": os.cpu_count()}, "seed": SEED}
    for dataset in QUICK if quick else (STREET, HALL):
        figures[dataset.name] = (
            measure(dataset) if dataset.available else f"skipped: {dataset.folder} is not beside the checkout"
        )
    return figures


def measure(dataset: Dataset) -> dict[str, Any]:
    """Builds the map from nothing with ``firstfix build``, then asks with ``firstfix evaluate --url``."""
    with tempfile.TemporaryDirectory(prefix="firstfix-bench-") as folder:
        scratch, store = Path(folder), Path(folder) / "store"
        config = scratch / "config.json"
        config.write_text(json.dumps(dataset.config))
        trajectory = dataset.write_trajectory(scratch / "trajectory.csv")
        queries = dataset.write_queries(scratch / "poses.csv")
        recorded = dataset.write_queries(scratch / "recorded.csv", recorded=True)
        build = ["build", str(dataset.map_path), "--map-id", dataset.name, "--store", str(store)]
        build += [
            "--trajectory",
            str(trajectory),
            "--config",
            str(config),
            "--work",
            str(scratch / "work"),
            "--json",
        ]
        begin = time.monotonic()
        with PeakMemory() as memory:
            built = json.loads(_firstfix(*build))
        built |= {
            "build_s": round(time.monotonic() - begin, 1),
            "build_peak_gb": round(memory.peak_bytes / 1e9, 2),
        }
        answers = {name: scratch / f"{name}.json" for name in ("first", "queries", "recorded")}
        with local_service(scratch / "service", store) as service:
            for name, poses in (("first", queries), ("queries", queries), ("recorded", recorded)):
                evaluate = ["evaluate", str(poses), "--map", dataset.name, "--url", service.url]
                evaluate += ["--random-yaw", str(SEED), "--json", str(answers[name])]
                print(_firstfix(*evaluate), file=sys.stderr)  # the first of them loads the version
        version = Catalog(Store.open(str(store))).fetch_version(
            dataset.name, built["version"], scratch / "versions"
        )
        return {
            "build": built,
            "queries": json.loads(answers["queries"].read_text()),
            "against_recorded_poses": json.loads(answers["recorded"].read_text()),
            "degraded": degraded(
                Localizer(MapIndex.load(version)),
                read_poses_csv(queries),
                BuildConfig.parse(dataset.config).sensor_model,
            ),
        }


def degraded(localizer: Localizer, rows: list[PosedScan], sensor: SensorModel) -> dict[str, Any]:
    """Every held-out scan in every variant, asked in this process.

    Of each variant the figures of ``firstfix evaluate``, and ``success_0.1m_0.5deg`` and so on: position
    and whole rotation of the answered pose within.
    """
    by_variant: dict[str, list[Outcome]] = {}
    localizer.localize(read_scan_file(rows[0].path))  # the first pays for what is loaded late
    for number, row in enumerate(rows):
        assert row.T_map_sensor is not None
        scan = read_scan_file(row.path)
        for name, worse, T_map_sensor in variants(scan, row.T_map_sensor, sensor, number):
            began = time.perf_counter()
            answer = localizer.localize(worse)
            ms = 1e3 * (time.perf_counter() - began)
            outcome = outcome_of(f"{row.path.name}, {name}", T_map_sensor, answer, ms)
            by_variant.setdefault(name, []).append(outcome)
    figures = {name: _figures(outcomes) for name, outcomes in by_variant.items()}
    for name, row_figures in figures.items():
        print(name, row_figures, file=sys.stderr)
    return figures


def variants(
    scan: Scan, T_map_sensor: Matrix, sensor: SensorModel, number: int
) -> Iterator[tuple[str, Scan, Matrix]]:
    """The scan as it is, and degraded in each way; and all of these again, turned by a random yaw."""
    rng = np.random.default_rng([SEED, number])
    as_it_is = (
        ("as it is", scan, T_map_sensor),
        ("every second ring", every_second_ring(scan, sensor), T_map_sensor),
        ("30 % lost in sectors", without_sectors(scan, LOST, rng), T_map_sensor),
        ("rolled and pitched by 5 deg", *tilted(scan, T_map_sensor, TILT_DEG, rng)),
    )
    yield from as_it_is
    for (name, worse, T), yaw in zip(as_it_is, random_yaws(len(as_it_is), SEED + number), strict=True):
        yield f"{name}, random yaw", *turned(worse, T, float(yaw))


def _figures(outcomes: list[Outcome]) -> dict[str, Any]:
    shares = {
        f"success_{limit_m:g}m_{limit_deg:g}deg": float(
            np.mean([o.error_m <= limit_m and o.error_deg <= limit_deg for o in outcomes])
        )
        for limit_m, limit_deg in LIMITS
    }
    return shares | report_of(outcomes)


def _firstfix(*arguments: str) -> str:
    command = [sys.executable, "-m", "firstfix_cli.main", *arguments]
    return subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout
