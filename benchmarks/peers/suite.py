"""Every peer over the held-out scans of the street and the hall, in one run.

    python -m benchmarks.run peers [--quick] [--json FILE]

Leaves ``report.md`` in ``build/bench/peers``, beside the build's stage cache.
"""

from __future__ import annotations

import os
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from firstfix.builds.config import BuildConfig
from firstfix.decode import read_scan_file
from firstfix.scan.scan import Scan
from firstfix.transform import Matrix, pose_error
from firstfix_builder.pipeline import build_version
from firstfix_cli.evaluate import random_yaws, turned
from firstfix_cli.poses_csv import read_poses_csv

from ..common.datasets import HALL, STREET, Dataset
from .fpfh import Fpfh
from .kiss import Kiss
from .ours import Ours
from .peer_input import PeerInput
from .scan_context import ScanContextPeer
from .trial import LIMIT_S, Peer, Trial

WORK = Path(__file__).parents[2] / "build" / "bench" / "peers"
SEED = 1  # of the yaw that each scan is turned by
QUICK_SCANS = 3
RIGHT_M, RIGHT_DEG = 0.2, 1.0
OURS = "firstfix"
PEERS: dict[str, type[Peer]] = {
    OURS: Ours,
    "Scan Context + our registration": ScanContextPeer,
    "FPFH + RANSAC + ICP": Fpfh,
    "KISS-Matcher + ICP": Kiss,
}
FEATURE_VOXEL_M = {STREET.name: 1.0, HALL.name: 0.5}
NEAR_M = {STREET.name: 2.5, HALL.name: 0.5}


def run(quick: bool) -> dict[str, Any]:
    """The quick suite asks three scans of the hall."""
    figures: dict[str, Any] = {"machine": {"cpus": os.cpu_count()}, "seed": SEED, "limit_s": LIMIT_S}
    for dataset in (HALL,) if quick else (STREET, HALL):
        if not dataset.available:
            figures[dataset.name] = f"skipped: {dataset.folder} is not beside the checkout"
            continue
        figures[dataset.name] = measure(dataset, QUICK_SCANS if quick else None, WORK / dataset.name)
    WORK.mkdir(parents=True, exist_ok=True)
    (WORK / "report.md").write_text(report(figures))
    return figures


def measure(dataset: Dataset, count: int | None, work: Path) -> dict[str, Any]:
    """Measures every peer on one data set.

    Args:
        count: of the scans; None: all.
    """
    work.mkdir(parents=True, exist_ok=True)
    trajectory = dataset.write_trajectory(work / "trajectory.csv")
    config = BuildConfig.parse(dataset.config)
    built = build_version(dataset.map_path, config, work, trajectory=trajectory)
    given = PeerInput(dataset, built.directory, FEATURE_VOXEL_M[dataset.name], NEAR_M[dataset.name])
    queries = _queries(dataset, count, work)
    figures: dict[str, Any] = {}
    for name, make in PEERS.items():
        if make is Kiss and find_spec("kiss_matcher") is None:
            figures[name] = "skipped: kiss-matcher is not installed"
            continue
        figures[name] = _trial(make, given, queries)
        print(dataset.name, name, figures[name], file=sys.stderr, flush=True)
    ours_s = figures[OURS]["median_s"]
    for row in figures.values():
        if isinstance(row, dict):
            row["times_ours"] = round(row["median_s"] / ours_s, 1)
    return figures


def _queries(dataset: Dataset, count: int | None, work: Path) -> list[tuple[Scan, Matrix]]:
    """Held-out scans, turned by a random yaw, and T_map_sensor; ``count`` of them evenly spread."""
    rows = read_poses_csv(dataset.write_queries(work / "poses.csv"))
    yaws = random_yaws(len(rows), SEED)
    found = []
    for k in np.linspace(0, len(rows) - 1, count or len(rows)).round().astype(int):
        scan, T_map_sensor = turned(read_scan_file(rows[k].path), rows[k].T_map_sensor, float(yaws[k]))
        assert T_map_sensor is not None
        found.append((scan, T_map_sensor))
    return found


def _trial(make: type[Peer], given: PeerInput, queries: list[tuple[Scan, Matrix]]) -> dict[str, Any]:
    errors, seconds = [], []
    with Trial(make, given) as trial:
        for scan, T_map_sensor in queries:
            found = trial.ask(scan)
            answered = found.T_map_sensor is not None
            errors.append(pose_error(T_map_sensor, found.T_map_sensor) if answered else (np.inf, np.inf))
            seconds.append(found.seconds)
    median_m = float(np.median([m for m, _ in errors]))
    return {
        "n": len(queries),
        "success_0.2m_1deg": round(
            float(np.mean([m <= RIGHT_M and deg <= RIGHT_DEG for m, deg in errors])), 4
        ),
        "median_error_m": round(median_m, 4) if np.isfinite(median_m) else None,
        "median_s": round(float(np.median(seconds)), 4),
        "timed_out": sum(s >= LIMIT_S for s in seconds),
    }


def report(figures: dict[str, Any]) -> str:
    """A Markdown table a data set."""
    parts = []
    for name in (STREET.name, HALL.name):
        rows = figures.get(name)
        if isinstance(rows, str):
            parts.append(f"### {name}\n\n{rows}\n")
        if not isinstance(rows, dict):
            continue
        lines = [
            f"### {name}",
            "",
            "| method | scans | 0.2 m, 1 deg | median error m | median s | times ours | timed out |",
            "|---|---|---|---|---|---|---|",
        ]
        for peer, row in rows.items():
            keys = ("n", "success_0.2m_1deg", "median_error_m", "median_s", "times_ours", "timed_out")
            cells = [row] if isinstance(row, str) else [str(row[key]) for key in keys]
            lines.append(f"| {peer} | " + " | ".join(cells) + " |")
        parts.append("\n".join(lines) + "\n")
    return "\n".join(parts)
