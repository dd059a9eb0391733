"""A map of nothing but mapping scans, from the folder to the report: the self-test asks some of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from firstfix.builds.config import BuildConfig
from firstfix.sensor import SensorModel
from firstfix.transform import make_transform
from firstfix_builder.pipeline import build_version
from firstfix_builder.simulation.rays import Rays
from firstfix_builder.simulation.simulate import Simulator
from firstfix_builder.sources.read_map.scan_folders import FOLDER
from firstfix_cli.map_source import as_one_file
from tests.small_world import COARSE_CONFIG, SENSOR, SmallWorld

pytestmark = pytest.mark.slow
ORIGIN = np.array([353_000.0, 5_425_000.0, 30.0])
KEYFRAMES = 60


@pytest.fixture(scope="module")
def run(small_world: SmallWorld, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Scans round the yard, in UTM coordinates."""
    source = tmp_path_factory.mktemp("run") / "yard"
    (source / FOLDER).mkdir(parents=True)
    sensor = SensorModel.from_mapping(SENSOR)
    simulator, rays = Simulator(small_world.vertices, small_world.triangles), Rays.of_sensor(sensor)
    rows = ["scan,tx,ty,tz,qx,qy,qz,qw"]
    for number, angle in enumerate(np.linspace(0, 2 * np.pi, KEYFRAMES, endpoint=False)):
        turn = Rotation.from_euler("z", angle + 1.6)
        T = make_transform(turn.as_matrix(), [6.0 * np.cos(angle), 4.0 * np.sin(angle), 0.8])
        (ranges,) = next(iter(simulator.ranges(T[None], sensor, rays)))
        met = np.isfinite(ranges)
        np.save(
            source / FOLDER / f"{number}.npy", (rays.directions[met] * ranges[met, None]).astype(np.float32)
        )
        words = [*(T[:3, 3] + ORIGIN).tolist(), *turn.as_quat().tolist()]
        rows.append(",".join(map(str, [f"{number}.npy", *words])))
    (source / FOLDER / "poses.csv").write_text("\n".join([*rows, "lost.npy,,,,,,,"]) + "\n")
    return source


def test_a_build_asks_the_keyframes_that_are_not_in_its_map(run: Path, tmp_path: Path):
    config = BuildConfig.parse(COARSE_CONFIG)
    built = build_version(run, config, tmp_path / "work")
    tested = built.manifest.self_test
    real = tested["real"]
    assert real["held_out"] == {"keyframes": 6, "parts": 3, "kept_out": {}}
    assert real["asked"] == real["of_source"]["asked"] == 6
    assert 3 < real["of_source"]["found"] <= 6
    assert real["left_out"] == {}
    assert real["success"]["1m"] > 0.5, "the map and its sensor are coarse"
    assert real["false_accepts"] == 0
    assert tested["moving"]["not_used"] == {"lost.npy": "it has no pose"}
    assert tested["mapped"]["places"] > 0, "the poses are the trajectory"
    built.manifest.verify_directory(built.directory)

    with as_one_file(run) as archive:  # from nothing: the same scans are held out, and answered the same
        packed = build_version(archive, config, tmp_path / "packed")
    assert packed.manifest.self_test["real"] == real

    all_in = BuildConfig.parse({**COARSE_CONFIG, "self_test": {**COARSE_CONFIG["self_test"], "held_out": 0}})
    whole = build_version(run, all_in, tmp_path / "work")
    assert whole.manifest.self_test["real"] == {}
    assert whole.manifest.digest != built.manifest.digest
