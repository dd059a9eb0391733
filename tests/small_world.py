"""A small world and its built versions, shared by the tests that need real ones."""

from __future__ import annotations

import os
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from numpy.typing import NDArray

if TYPE_CHECKING:  # a plugin too, and open3d: both are imported when a test needs them
    from firstfix_builder.job.build_job import BuildResult
    from tests.once_a_run import OnceARun


@dataclass(frozen=True)
class SmallWorld:
    """A yard of 16 x 12 m with a wall round it, a dozen boxes and a cabin: no two spots look alike."""

    vertices: NDArray[np.float64]
    triangles: NDArray[np.int64]

    def write(self, path: Path) -> Path:
        import trimesh

        trimesh.Trimesh(self.vertices, self.triangles, process=False).export(path)
        return path


SENSOR = {
    "name": "test-16",
    "elevations_deg": [float(v) for v in np.linspace(-15, 15, 16)],
    "azimuth_step_deg": 0.6,
    "min_range_m": 0.3,
    "max_range_m": 60.0,
    "mount_height_m": 0.8,
}
CONFIG = {"sensor": SENSOR, "learn_keys": {"scans": 300}, "self_test": {"queries": 40, "outside": 10}}
# A tenth of the work, and something to do for every stage: for tests that look at stages and not at answers.
COARSE_CONFIG = {
    "sensor": {**SENSOR, "azimuth_step_deg": 2.4},
    "viewpoints": {"spacing_m": 1.5},
    "engine": {"search": {"clusters": 20}},  # fewer than there are templates, so that keys are learned
    "learn_keys": {"scans": 60},
    "self_test": {"queries": 4, "outside": 2},
}


@pytest.fixture(scope="session")
def small_world() -> SmallWorld:
    return yard()


def yard() -> SmallWorld:
    rng = np.random.default_rng(4)
    boxes = [([0, 0, -0.1], [16.4, 12.4, 0.2], 0.0)]
    for x, y, w, d in ((-8.1, 0, 0.2, 12.4), (8.1, 0, 0.2, 12.4), (0, -6.1, 16.4, 0.2), (0, 6.1, 16.4, 0.2)):
        boxes.append(([x, y, 1.5], [w, d, 3.0], 0.0))
    for _ in range(12):
        size = rng.uniform(0.4, 1.8, 3)
        boxes.append(([*rng.uniform([-7, -5], [7, 5]), size[2] / 2], size, rng.uniform(0, np.pi)))
    boxes.append(([5.0, 3.5, 1.2], [3.0, 2.0, 2.4], 0.3))
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])
    vertices = []
    for centre, size, yaw in boxes:
        c, s = np.cos(yaw), np.sin(yaw)
        turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        vertices.append((corners * size) @ turn.T + centre)
    triangles = np.concatenate([faces + 8 * i for i in range(len(boxes))])
    return SmallWorld(np.concatenate(vertices), triangles)


@pytest.fixture(scope="session")
def small_map(small_world: SmallWorld, once_a_run: OnceARun) -> Path:
    """The world as a mesh file."""
    return once_a_run.folder("yard", lambda folder: small_world.write(folder / "yard.ply")) / "yard.ply"


@pytest.fixture(scope="session")
def small_version(small_map: Path, once_a_run: OnceARun) -> BuildResult:
    """The world's version, to be read only; ``small_work`` has its stages."""
    return once_a_run.version("yard-version", lambda folder: small_map, CONFIG)


@pytest.fixture(scope="session")
def coarse_version(small_map: Path, once_a_run: OnceARun) -> BuildResult:
    """The world's coarse version, to be read only; ``coarse_work`` has its stages."""
    return once_a_run.version("yard-coarse", lambda folder: small_map, COARSE_CONFIG)


@pytest.fixture
def coarse_work(coarse_version: BuildResult, tmp_path: Path) -> Path:
    """A work folder of its own that holds the stages of the coarse version's build."""
    return begun_as(coarse_version, tmp_path / "work")


@pytest.fixture
def small_work(small_version: BuildResult, tmp_path: Path) -> Path:
    """A work folder of its own that holds the stages of the small version's build."""
    return begun_as(small_version, tmp_path / "work")


def begun_as(built: BuildResult, work: Path) -> Path:
    """Makes a work folder whose builds continue from the stages of a built version."""
    shutil.copytree(built.directory.parent / "stages", work / "stages", copy_function=os.link)
    return work


@pytest.fixture(scope="session")
def small_scans(small_world: SmallWorld, small_version: BuildResult):
    """Perturbed scans between the version's templates: (Scan, T_map_sensor)."""
    from firstfix.builds.config import PerturbConfig
    from firstfix.engine.index import MapIndex
    from firstfix.sensor import SensorModel
    from firstfix_builder.simulation.perturb import perturbed_scans
    from firstfix_builder.simulation.simulate import Simulator

    positions = MapIndex.load(small_version.directory).cascade.templates.position_m
    return perturbed_scans(
        Simulator(small_world.vertices, small_world.triangles),
        SensorModel.from_mapping(SENSOR),
        positions,
        1.0,
        20,
        PerturbConfig(occluders=3, unmapped=0, vanished=0),
        np.random.default_rng(11),
    )
