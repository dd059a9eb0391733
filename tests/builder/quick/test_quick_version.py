"""The provisional version of a map with a trajectory, in the flow of a build."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from firstfix.builds.config import BuildConfig
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer
from firstfix.errors import BuildCancelled
from firstfix.scan.scan import Scan
from firstfix.transform import pose_error, rotation_z
from firstfix_builder.pipeline import build_version
from firstfix_builder.quick.quick_version import QuickVersion
from firstfix_builder.simulation.rays import Rays
from firstfix_builder.simulation.simulate import Simulator
from firstfix_builder.sources.read_map.held_out import HeldOut
from firstfix_builder.sources.read_map.posed_cloud import PosedCloud
from tests.changed_yard import write_cloud
from tests.small_world import COARSE_CONFIG, SmallWorld

CONFIG = {**COARSE_CONFIG, "sensor": {**COARSE_CONFIG["sensor"], "azimuth_step_deg": 0.6}}
CONFIG["self_test"] = {"queries": 12, "outside": 2}
RUN_M = np.linspace(-6.0, 6.0, 40)


@pytest.fixture(scope="module")
def cloud(small_world: SmallWorld, tmp_path_factory) -> Path:
    return write_cloud(small_world, tmp_path_factory.mktemp("cloud") / "yard.npy")


@pytest.fixture(scope="module")
def poses(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("poses") / "poses.txt"
    T = np.tile(np.eye(4), (len(RUN_M), 1, 1))
    T[:, 0, 3], T[:, 2, 3] = RUN_M, 0.8
    path.write_text("\n".join(" ".join(map(str, one[:3].ravel())) for one in T))
    return path


class Published:
    """The provisional versions of a build, and which of its stages had ended when each came."""

    def __init__(self, work: Path) -> None:
        self.work = work
        self.versions, self.ended = [], []

    def __call__(self, built) -> None:
        self.ended.append(
            [one.name for one in (self.work / "stages").iterdir() if not one.name.startswith(".")]
        )
        self.versions.append((built.manifest, MapIndex.load(built.directory)))
        built.manifest.verify_directory(built.directory)


class Stop(Exception):
    pass


def first_of(source: Path, poses: Path | None, work: Path, config=CONFIG) -> Published:
    """The provisional versions of a build, which is stopped when the map was read and they were made."""
    published = Published(work)

    def stop(stage: str, fraction: float) -> None:
        if stage == "reconstruct_mesh":
            raise Stop

    with pytest.raises(Stop):
        build_version(
            source,
            BuildConfig.parse(config),
            work,
            trajectory=poses,
            progress=stop,
            publish_provisional=published,
        )
    return published


def test_a_map_with_poses_has_a_first_version_before_it_is_cleaned(cloud, poses, tmp_path):
    published = first_of(cloud, poses, tmp_path / "work")
    ((manifest, _),) = published.versions
    assert published.ended == [[]], "not even the first stage"
    assert manifest.provisional
    assert manifest.self_test["queries"] == 12
    assert manifest.self_test["found"] >= 0.9
    assert manifest.counts["templates"] == manifest.counts["clusters"] == 9, "one in 1.5 m of the run"


def test_scans_are_localized_in_the_first_version(cloud, poses, tmp_path, small_world):
    ((_, index),) = first_of(cloud, poses, tmp_path / "work").versions
    localizer = Localizer(index)
    config = BuildConfig.parse(CONFIG)
    simulator = Simulator(small_world.vertices, small_world.triangles)
    rng, localized = np.random.default_rng(5), 0
    for x_m in (-4.7, -2.1, 0.4, 3.3, 5.2):
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = rotation_z(rng.uniform(-3, 3)), [x_m, 0.15, 0.8]
        rays = Rays.of_sensor(config.sensor_model)
        (ranges,) = next(simulator.ranges(T[None], config.sensor_model, rays))
        seen = np.isfinite(ranges)
        answer = localizer.localize(Scan.from_points(rays.directions[seen] * ranges[seen, None]))
        if answer.T_map_sensor is not None:
            localized += 1
            assert pose_error(T, answer.T_map_sensor)[0] < 0.1
    assert localized >= 4


def test_a_map_that_was_read_before_has_one_too(cloud, poses, tmp_path):
    first_of(cloud, poses, tmp_path / "work")
    again = first_of(cloud, poses, tmp_path / "work")
    ((manifest, _),) = again.versions
    (ended,) = again.ended
    assert len(ended) == 1, "the map was not read again"
    assert manifest.self_test["found"] >= 0.9


def test_a_map_without_poses_has_a_provisional_version_of_its_surface(cloud, tmp_path):
    ((manifest, _),) = first_of(cloud, None, tmp_path / "work").versions
    assert manifest.provisional
    assert manifest.self_test == {}


@pytest.mark.parametrize(
    "config",
    [
        {**CONFIG, "self_test": {"queries": 0}},
        {**CONFIG, "sensor": {**CONFIG["sensor"], "max_range_m": 1.2}},
    ],
    ids=["no test", "a sensor that sees too little"],
)
def test_a_first_version_that_its_test_does_not_show_is_not_published(config, cloud, poses, tmp_path, caplog):
    versions = first_of(cloud, poses, tmp_path / "work", config).versions
    assert all(manifest.self_test == {} for manifest, _ in versions), "those are made of the surface"
    assert "no provisional version from the poses of the run" in caplog.text


@pytest.mark.parametrize("points", [np.zeros((1, 3)), np.full((3, 3), 500.0), np.eye(3)], ids=str)
def test_a_cloud_that_no_version_can_be_made_of_fails_no_build(points, tmp_path, caplog):
    cloud = PosedCloud(points, np.tile(np.eye(4), (2, 1, 1)), 0.1, np.eye(4), [], HeldOut())
    with ThreadPoolExecutor(2) as threads:
        quick = QuickVersion(BuildConfig.parse(CONFIG), tmp_path / "quick", threads, pytest.fail)
        quick.make(cloud)
    assert quick.is_tried
    assert not quick.is_published
    assert "no provisional version from the poses of the run" in caplog.text


def test_what_happens_as_it_is_published_ends_the_build(cloud, poses, tmp_path):
    def publish(built) -> None:
        raise BuildCancelled("now")

    with pytest.raises(BuildCancelled, match="now"):
        build_version(
            cloud, BuildConfig.parse(CONFIG), tmp_path / "work", trajectory=poses, publish_provisional=publish
        )
