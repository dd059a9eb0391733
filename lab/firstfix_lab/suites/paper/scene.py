"""A simulated world of the paper's kind: templates 0.2 m apart on both sides of a drive, and queries.

The campus world, a 16-beam scanner, every spot beside the track where the robot can stand, as many as are
asked for from the track's beginning on. Kept under ``build/bench``: simulating 100k scans takes minutes.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from firstfix import descriptor
from firstfix.builds.config import PerturbConfig, ViewpointConfig
from firstfix.descriptor import (
    Described,
    Descriptor,
    LayeredOccupancy,
    PolarGrid,
    ScanBatch,
    rows_of,
)
from firstfix.descriptor.pca_sc import PcaScanContext
from firstfix.scan.scan import Scan
from firstfix.sensor import preset
from firstfix.transform import Matrix
from firstfix_builder.execution.stage_cache import StageCache
from firstfix_builder.simulation import simulate
from firstfix_builder.simulation.perturb import perturbed_scans
from firstfix_builder.simulation.simulate import Simulator, upright
from firstfix_builder.templates.make import scan_batch
from firstfix_builder.viewpoints.sample import sample_viewpoints
from firstfix_cli.sample_world.drive import drive

from ...worlds.campus import campus
from ...worlds.make_world import NAMES

SEED = 0
SPACING_M = 0.2
MAX_RANGE_M = 60.0
MAX_RAYS = 16_384
AT_ONCE = 128
TRACK_STEP_M = 0.16  # 1.6K trajectory points to 100K templates, as in the paper
SENSOR = preset("vlp-16")
GRID = PolarGrid(20, 60, MAX_RANGE_M)
DESCRIPTORS: dict[str, Descriptor] = {
    "drop": PcaScanContext(GRID, ground="drop"),
    "keep": PcaScanContext(GRID, ground="keep"),
    "raw": PcaScanContext(GRID, ground="raw"),
    "occupancy": LayeredOccupancy(GRID),
}
PAPER = "drop"
# what the paper does not show: held-out places, and all that goes wrong in a real scan
PERTURBED = PerturbConfig(
    noise_m=0.02, dropout=0.1, occluders=6, strangers=0, unmapped=0, vanished=0, height_m=0.1, tilt_deg=2.0
)


@dataclass(frozen=True)
class Taken:
    """Scans taken upright somewhere, described in every way.

    Attributes:
        position_m: (n, 3).
        by: name in DESCRIPTORS to the n descriptions.
    """

    position_m: NDArray[np.float32]
    by: dict[str, Described]

    def __len__(self) -> int:
        return len(self.position_m)

    def subset(self, rows: NDArray[np.integer]) -> Taken:
        return Taken(self.position_m[rows], {name: rows_of(d, rows) for name, d in self.by.items()})

    def save(self, directory: Path) -> None:
        np.save(directory / "position_m.npy", self.position_m)
        for name, described in self.by.items():
            for array in described:
                np.save(directory / f"{name}-{array}.npy", described[array])

    @classmethod
    def load(cls, directory: Path) -> Taken:
        by = {
            name: {array: np.load(directory / f"{name}-{array}.npy") for array in how.arrays}
            for name, how in DESCRIPTORS.items()
        }
        return cls(np.load(directory / "position_m.npy"), by)


@dataclass(frozen=True)
class Scene:
    """The simulated world with its templates.

    Attributes:
        mount_m: of the sensor above the floor.
        templates: re-sampled points.
        trajectory: along the drive that the templates stand beside.
    """

    simulator: Simulator
    mount_m: float
    templates: Taken
    trajectory: Taken

    def perturbed(self, count: int, seed: int = 1) -> list[tuple[Scan, Matrix]]:
        """Held-out scans between the templates and their T_map_sensor: any heading, all that goes wrong."""
        rng = np.random.default_rng(seed)
        around = self.templates.position_m
        return perturbed_scans(self.simulator, SENSOR, around, SPACING_M, count, PERTURBED, rng)


def make_scene(count: int, beside_track_m: float, work: Path) -> Scene:
    """Make a scene with ``count`` templates, no further from the track than ``beside_track_m``."""
    place = campus(np.random.default_rng([SEED, NAMES.index("campus"), 0]))
    mesh, path = place.mesh(), drive(place)
    simulator = Simulator(mesh.vertices, mesh.triangles)
    near = ViewpointConfig(spacing_m=SPACING_M, max_distance_to_trajectory_m=beside_track_m)
    viewpoints = sample_viewpoints(simulator, near, SENSOR.mount_height_m, path)
    track = _every(path[:, :3, 3], TRACK_STEP_M)
    along = cKDTree(track[:, :2]).query(viewpoints.positions[:, :2])[1]
    rows = np.sort(np.argsort(along, kind="stable")[:count])
    mount_m = viewpoints.mount_height_m
    cache = StageCache(work, code_version=_code_version())

    def taken(name: str, position_m: NDArray[np.float64]) -> Taken:
        inputs = {"mesh": _digest(mesh.vertices, mesh.triangles), "positions": _digest(position_m)}
        made = cache.run(
            f"paper_{name}", inputs, {}, lambda out: _described(simulator, position_m, mount_m).save(out)
        )
        return Taken.load(made.directory)

    return Scene(
        simulator,
        mount_m,
        taken("templates", viewpoints.positions[rows]),
        taken("trajectory", track[: along[rows].max() + 1]),
    )


def _digest(*arrays: NDArray[Any]) -> str:
    return sha256(b"".join(np.ascontiguousarray(array).tobytes() for array in arrays)).hexdigest()


def _code_version() -> str:
    """Hash of the code that makes descriptions. A change of other code leaves scenes cached."""
    files = [*sorted(Path(descriptor.__file__).parent.glob("*.py")), Path(simulate.__file__), Path(__file__)]
    return sha256(b"".join(file.read_bytes() for file in files)).hexdigest()


def _every(line: NDArray[np.float64], step_m: float) -> NDArray[np.float64]:
    """(p, 3) corner points to points a step apart along them."""
    run = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    at = np.arange(0, run[-1], step_m)
    return np.column_stack([np.interp(at, run, line[:, axis]) for axis in range(3)])


def _described(simulator: Simulator, position_m: NDArray[np.float64], mount_m: float) -> Taken:
    sensor = SENSOR.coarser(MAX_RAYS)
    directions = sensor.directions()

    def chunk(start: int) -> dict[str, Described]:
        here = upright(position_m[start : start + AT_ONCE])
        ranges = np.concatenate(list(simulator.ranges(here, sensor)))
        scans: ScanBatch = scan_batch(ranges, directions, np.full(len(here), mount_m))
        return {name: how.describe(scans) for name, how in DESCRIPTORS.items()}

    with ThreadPoolExecutor() as threads:
        parts = list(threads.map(chunk, range(0, len(position_m), AT_ONCE)))
    by = {
        name: {array: np.concatenate([part[name][array] for part in parts]) for array in how.arrays}
        for name, how in DESCRIPTORS.items()
    }
    return Taken(position_m.astype(np.float32), by)
