"""Every peer over held-out scans of the real maps, in one run.

    python -m benchmarks.run peers [--quick] [--sets street,hall] [--scans N] [--bbs PREFIX] [--json FILE]

KISS-Matcher and 3D-BBS are asked if they are installed; 3D-BBS as its README says, at PREFIX. Leaves
``report.md`` in ``build/bench/peers``.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from firstfix.builds.config import BuildConfig
from firstfix.decode import read_scan_file
from firstfix.scan.scan import Scan
from firstfix.transform import Matrix
from firstfix_builder.pipeline import build_version
from firstfix_cli.evaluate import random_yaws, turned
from firstfix_cli.pose_gravity import gravity_at
from firstfix_cli.poses_csv import read_poses_csv

from ..common.by_dataset import measure_each
from ..common.datasets import DATASETS, GARAGE, HALL, STREET, YARD, Dataset
from . import bbs
from .figures import figures_of
from .fpfh import Fpfh
from .kiss import Kiss
from .ours import Ours, OursWithGravity
from .peer_input import PeerInput
from .report import report
from .scan_context import ScanContextPeer
from .trial import LIMIT_S, Found, Peer, Trial

WORK = Path(__file__).parents[2] / "build" / "bench" / "peers"
SEED = 1  # of the scans that are asked, and of the yaw that each is turned by
SCANS, QUICK_SCANS = 6, 3
OURS, WITH_GRAVITY = "firstfix", "firstfix, gravity given"
PEERS: dict[str, type[Peer]] = {
    OURS: Ours,
    WITH_GRAVITY: OursWithGravity,
    "Scan Context + our registration": ScanContextPeer,
    "FPFH + RANSAC + ICP": Fpfh,
    "KISS-Matcher + ICP": Kiss,
    "3D-BBS (CPU) + GICP, gravity given": bbs.Bbs,
}


@dataclass(frozen=True)
class Scale:
    """Lengths for one place, as the peers' authors choose them for streets and for rooms.

    In the yard FPFH finds some of the thin scans at 0.5 m and none at 1 m; KISS-Matcher finds none at either.
    """

    fpfh_voxel_m: float
    kiss_voxel_m: float
    bbs_level_m: float
    near_m: float


SCALES = {
    STREET.name: Scale(1.0, 1.0, 1.0, 2.5),
    HALL.name: Scale(0.5, 0.5, 0.5, 0.5),
    YARD.name: Scale(0.5, 1.0, 1.0, 0.5),
    GARAGE.name: Scale(0.5, 0.5, 0.5, 1.0),
}


@dataclass(frozen=True)
class Query:
    """A held-out scan, its true pose, and the direction of gravity there."""

    name: str
    scan: Scan
    T_map_sensor: Matrix
    gravity: NDArray[np.float64]


def run(quick: bool, sets: Sequence[str] = (), scans: int = SCANS, bbs: Path | None = None) -> dict[str, Any]:
    """The quick suite asks three scans of the hall.

    Args:
        sets: names of the data sets; empty: all that have a scale.
        scans: queries of each data set at most.
        bbs: where 3D-BBS is installed.
    """
    asked = (HALL,) if quick else [dataset for dataset in DATASETS if dataset.name in SCALES]
    count = QUICK_SCANS if quick else scans
    by_dataset = measure_each(asked, sets, lambda dataset, folder: measure(dataset, count, bbs, folder))
    WORK.mkdir(parents=True, exist_ok=True)
    (WORK / "report.md").write_text(report(by_dataset))
    return {"machine": {"cpus": os.cpu_count()}, "seed": SEED, "limit_s": LIMIT_S, **by_dataset}


def measure(dataset: Dataset, count: int, bbs_prefix: Path | None, work: Path) -> dict[str, Any]:
    """Builds our version of a map from nothing, then asks every peer.

    Args:
        count: of the scans, at most.
        work: an empty folder.
    """
    trajectory = dataset.write_trajectory(work / "trajectory.csv")
    began = time.monotonic()
    built = build_version(
        dataset.map_path, BuildConfig.parse(dataset.config), work / "build", trajectory=trajectory
    )
    build_s = time.monotonic() - began
    figures = compare(dataset, built.directory, queries_of(dataset, count, work), bbs_prefix, work)
    for name in (OURS, WITH_GRAVITY):
        figures[name]["preparation_s"] = round(build_s, 2)
    return figures


def compare(
    dataset: Dataset, version: Path, queries: Sequence[Query], bbs_prefix: Path | None, work: Path
) -> dict[str, Any]:
    """Asks every peer the same queries, one peer after the other.

    Args:
        version: folder of our version of the map.
    """
    scale = SCALES[dataset.name]
    no_bbs = bbs.why_not(bbs_prefix)
    driver = None if no_bbs or bbs_prefix is None else bbs.build_driver(bbs_prefix, work)
    given = PeerInput(dataset, work, version, **vars(scale), bbs_driver=driver)
    given.write_map_points()
    skipped = {
        bbs.Bbs: no_bbs,
        Kiss: None if find_spec("kiss_matcher") else "kiss-matcher is not installed",
        ScanContextPeer: None if dataset.mapping_file else "the data set has no scans of the mapping run",
    }
    figures: dict[str, Any] = {"asked": [query.name for query in queries]}
    print(dataset.name, "asked:", *figures["asked"], file=sys.stderr, flush=True)
    for name, make in PEERS.items():
        why_not = skipped.get(make)
        figures[name] = f"skipped: {why_not}" if why_not else _trial(make, given, queries)
        print(dataset.name, name, figures[name], file=sys.stderr, flush=True)
    return figures


def queries_of(dataset: Dataset, count: int, work: Path) -> list[Query]:
    """``count`` held-out scans at most, drawn by a seed, each turned by a random yaw."""
    rows = read_poses_csv(dataset.write_queries(work / "poses.csv"))
    yaws = random_yaws(len(rows), SEED)
    rng = np.random.default_rng([SEED, crc32(dataset.name.encode())])
    queries = []
    for k in sorted(rng.permutation(len(rows))[:count]):
        scan, T_map_sensor = turned(read_scan_file(rows[k].path), rows[k].T_map_sensor, float(yaws[k]))
        gravity = gravity_at(T_map_sensor, np.zeros(2))
        assert T_map_sensor is not None
        assert gravity is not None
        queries.append(Query(rows[k].path.name, scan, T_map_sensor, gravity))
    return queries


def _trial(make: type[Peer], given: PeerInput, queries: Sequence[Query]) -> dict[str, Any]:
    found: list[Found] = []
    with Trial(make, given) as trial:
        preparation_s = trial.preparation_s
        for query in queries:
            found.append(trial.ask(query.scan, query.gravity))
    figures = figures_of([query.T_map_sensor for query in queries], found)
    return {**figures, "preparation_s": round(preparation_s, 2)}
