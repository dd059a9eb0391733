"""Every peer over held-out scans of the real maps, in one run.

    firstfix-lab peers [--quick] [--sets street,hall] [--scans N] [--bbs PREFIX] [--json FILE]

KISS-Matcher, MapClosures and 3D-BBS are asked if they are installed; 3D-BBS as its README says, at PREFIX or
at the environment's BBS3D_PREFIX. Leaves ``report.md`` in ``build/bench/peers``. The quick suite asks in a
small simulated yard.
"""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np

from firstfix.scan.scan import Scan
from firstfix.scan_file import read_scan_file
from firstfix.transform import Matrix
from firstfix_cli.poses_csv import read_poses_csv
from firstfix_lab.checkout import BENCH
from tests.recorded_data import DATASETS, GARAGE, HALL, STREET, YARD, Dataset

from ...common.by_dataset import measure_each
from ...evaluation.outcome import random_yaws, turned
from ...evaluation.pose_gravity import gravity_at
from . import bbs
from .bbs2d import Bbs2d
from .build import Built, build
from .figures import answer_row, figures_of
from .fpfh import Fpfh
from .hdl_fpfh import HdlFpfh
from .kiss import Kiss, KissCropped
from .map_closures import MapClosuresPeer
from .ours import Ours, OursWithGravity, PaperMethod
from .peer_input import PeerInput
from .prior import Prior, coarse_positions
from .quick_place import QUICK, make_quick_place
from .report import OURS, report
from .scan_context import ScanContextPeer
from .trial import LIMIT_S, Peer, Preparation, Trial

WORK = BENCH / "peers"
SEED = 1  # of the scans that are asked, and of the yaw that each is turned by
SCANS, QUICK_SCANS = 6, 3
PAPER = "the paper's method, built on firstfix's mesh"
PREFIX = "BBS3D_PREFIX"
PEERS: dict[str, type[Peer]] = {
    OURS[0]: Ours,
    OURS[1]: OursWithGravity,
    PAPER: PaperMethod,
    "Scan Context + our registration, gravity given": ScanContextPeer,
    "FPFH + RANSAC (Open3D) + ICP": Fpfh,
    "FPFH + RANSAC (hdl) + ICP": HdlFpfh,
    "KISS-Matcher + ICP": Kiss,
    "KISS-Matcher + ICP, map cropped at a given position": KissCropped,
    "MapClosures + ICP": MapClosuresPeer,
    "BBS 2-D (hdl) + ICP, gravity given": Bbs2d,
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
    QUICK: Scale(0.5, 0.5, 0.5, 0.3),
}


@dataclass(frozen=True)
class Query:
    """A held-out scan, its true pose, and what peers may be told of it."""

    name: str
    scan: Scan
    T_map_sensor: Matrix
    prior: Prior


def run(quick: bool, sets: Sequence[str] = (), scans: int = SCANS, bbs: Path | None = None) -> dict[str, Any]:
    """Measures, and writes the report.

    Args:
        sets: names of the data sets; empty: all that have a scale.
        scans: queries of each data set at most.
        bbs: where 3D-BBS is installed.
    """
    prefix = bbs or (Path(os.environ[PREFIX]) if os.environ.get(PREFIX) else None)
    if quick:
        with tempfile.TemporaryDirectory(prefix="firstfix-bench-") as folder:
            asked = [make_quick_place(Path(folder))]
            by_dataset = measure_each(
                asked, (), lambda dataset, work: measure(dataset, QUICK_SCANS, prefix, work)
            )
    else:
        asked = [dataset for dataset in DATASETS if dataset.name in SCALES]
        by_dataset = measure_each(asked, sets, lambda dataset, work: measure(dataset, scans, prefix, work))
    WORK.mkdir(parents=True, exist_ok=True)
    (WORK / "report.md").write_text(report(by_dataset))
    return {"machine": {"cpus": os.cpu_count()}, "seed": SEED, "limit_s": LIMIT_S, **by_dataset}


def measure(dataset: Dataset, count: int, bbs_prefix: Path | None, work: Path) -> dict[str, Any]:
    """Build our version of a map from nothing, that of the paper's method on its mesh, then ask every peer.

    Args:
        count: of the scans, at most.
        work: an empty folder.
    """
    ours = build(dataset, {}, work, "ours")
    paper = build(dataset, {"method": "paper"}, work, "paper")
    return compare(dataset, ours, paper, queries_of(dataset, count, work), bbs_prefix, work)


def compare(
    dataset: Dataset, ours: Built, paper: Built, queries: Sequence[Query], bbs_prefix: Path | None, work: Path
) -> dict[str, Any]:
    """Ask every peer the same queries, one peer after the other.

    Args:
        ours, paper: versions of the map by firstfix's default method and by the paper's.
    """
    scale = SCALES[dataset.name]
    no_bbs = bbs.why_not(bbs_prefix)
    driver = None if no_bbs or bbs_prefix is None else bbs.build_driver(bbs_prefix, work)
    given = PeerInput(dataset, work, ours.folder, paper.folder, **vars(scale), bbs_driver=driver)
    given.write_map_points()
    no_kiss = None if find_spec("kiss_matcher") else "kiss-matcher is not installed"
    skipped = {
        bbs.Bbs: no_bbs,
        Kiss: no_kiss,
        KissCropped: no_kiss,
        MapClosuresPeer: None if find_spec("map_closures") else "map-closures is not installed",
    }
    figures: dict[str, Any] = {"asked": [query.name for query in queries]}
    print(dataset.name, "asked:", *figures["asked"], file=sys.stderr, flush=True)
    for name, make in PEERS.items():
        why_not = skipped.get(make)
        built = {PAPER: paper}.get(name, ours if name in OURS else None)
        if why_not:
            figures[name] = f"skipped: {why_not}"
        else:
            figures[name] = _trial(make, given, queries, built.preparation if built else None)
        print(dataset.name, name, figures[name], file=sys.stderr, flush=True)
    return figures


def queries_of(dataset: Dataset, count: int, work: Path) -> list[Query]:
    """``count`` held-out scans at most, drawn by a seed, each turned by a random yaw."""
    rows = read_poses_csv(dataset.write_queries(work / "poses.csv"))
    yaws, off_m = random_yaws(len(rows), SEED), coarse_positions(len(rows), SEED)
    rng = np.random.default_rng([SEED, crc32(dataset.name.encode())])
    queries = []
    for k in sorted(rng.permutation(len(rows))[:count]):
        scan, T_map_sensor = turned(read_scan_file(rows[k].path), rows[k].T_map_sensor, float(yaws[k]))
        gravity = gravity_at(T_map_sensor, np.zeros(2))
        assert T_map_sensor is not None
        assert gravity is not None
        prior = Prior(gravity, T_map_sensor[:2, 3] + off_m[k])
        queries.append(Query(rows[k].path.name, scan, T_map_sensor, prior))
    return queries


def _trial(
    make: type[Peer], given: PeerInput, queries: Sequence[Query], built: Preparation | None
) -> dict[str, Any]:
    """Figures of one peer.

    Args:
        built: what the peer's map took, if that is not what it does when it is made.
    """
    with Trial(make, given) as trial:
        rows = [
            answer_row(
                query.T_map_sensor,
                trial.ask(query.scan, query.prior),
                make.sent_bytes(given, query.scan),
            )
            for query in queries
        ]
        return figures_of(rows, built or trial.preparation, trial.peak_bytes)
