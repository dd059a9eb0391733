"""Places that the suite asks in: recorded ones, and worlds of the project; their maps and queries."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from zlib import crc32

import numpy as np

from firstfix.builds.config import BuildConfig
from firstfix.engine.config import ENGINE_FILE
from firstfix.engine.index import MapIndex
from firstfix.scan.descriptor_parameters import DescriptorParameters
from firstfix.scan.scan import Scan
from firstfix.scan_file import read_scan_file
from firstfix_builder.execution.stage_cache import StageCache
from firstfix_cli.poses_csv import read_poses_csv
from firstfix_client.steps.scan_body import BodyForm, encoded
from tests.recorded_data import HALL, STREET, STREET_128, YARD, Dataset

from ...common.load import Body
from ...common.worlds import WORLDS, WorldFiles, own_world
from ...evaluation.outcome import random_yaws, turned
from ..robust.cases import CASES
from ..robust.queries import queries_of
from .build import Source

SEED = 6
HEADINGS = 2  # random yaws that each recorded scan is turned by
FORMS = ("raw", "compact")
RECORDED = {dataset.name: dataset for dataset in (HALL, YARD, STREET, STREET_128)}
DEMO = "demo"  # the factory of ``firstfix world factory``, built from its cloud, with the world's own scans
CASE = next(case for case in CASES if case.name == "all at once")


@dataclass(frozen=True)
class Place:
    """A map to build, and scans to ask in it.

    Attributes:
        scans_in: takes at most so many scans in a version that this checkout built.
    """

    name: str
    source: Source
    scans_in: Callable[[Path, int], list[Scan]]


def recorded(dataset: Dataset, folder: Path) -> Place:
    """A recorded place, with its held-out scans, each at several headings."""
    folder.mkdir(parents=True, exist_ok=True)
    poses = folder / "poses.csv"

    def scans_in(version: Path, count: int) -> list[Scan]:
        dataset.write_queries(poses)
        taken = [read_scan_file(row.path) for row in read_poses_csv(poses)] * HEADINGS
        yaws = random_yaws(len(taken), SEED)
        return [turned(scan, None, float(yaw))[0] for scan, yaw in zip(taken, yaws, strict=True)][:count]

    trajectory = dataset.write_trajectory(folder / "trajectory.csv")
    return Place(dataset.name, Source(dataset.map_path, trajectory, dataset.config), scans_in)


def demo(folder: Path) -> Place:
    """The factory that a user tries first: strangers and hard scans are among its queries."""
    made = own_world("factory", mapped=True)
    files = made.make(StageCache(folder))

    def scans_in(version: Path, count: int) -> list[Scan]:
        return [scan for scan, _ in files.own_queries()][:count]

    return Place(DEMO, Source(files.source, files.map.trajectory, made.config), scans_in)


def world(name: str, folder: Path) -> Place:
    """A simulated world, with scans that have everything perturbed at once."""
    made = next(one for one in WORLDS if one.name == name)
    files: WorldFiles = made.make(StageCache(folder))

    def scans_in(version: Path, count: int) -> list[Scan]:
        rng = np.random.default_rng([SEED, crc32(name.encode())])
        sensor = BuildConfig.parse(made.config).sensor_model
        return [scan for scan, _ in queries_of(CASE, MapIndex.load(version), sensor, files, (), count, rng)]

    return Place(name, Source(files.map.mesh, files.map.trajectory, made.config), scans_in)


def missing(name: str) -> str | None:
    """A message if the place's data is not here."""
    dataset = RECORDED.get(name)
    if dataset is not None and not dataset.available:
        return f"skipped: {dataset.folder} is not beside the checkout"
    return None


def place(name: str, folder: Path) -> Place:
    """A place by its name. The folder keeps what is made for it."""
    if name in RECORDED:
        return recorded(RECORDED[name], folder)
    return demo(folder) if name == DEMO else world(name, folder)


def bodies_of(scans: list[Scan], version: Path) -> dict[str, list[Body]]:
    """The scans as raw points, and in the compact form that the version recommends."""
    parameters = DescriptorParameters.from_engine(json.loads((version / ENGINE_FILE).read_text()))
    compact = BodyForm("compact", parameters)
    return {
        "raw": [Body("application/vnd.firstfix.xyz", scan.points.tobytes()) for scan in scans],
        "compact": [Body(*encoded(scan, compact)) for scan in scans],
    }
