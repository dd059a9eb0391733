"""A real Mid-360 that turns on the spot: as recorded, upside down, and on its side."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from firstfix.builds.config import BuildConfig
from firstfix.decode import read_scan_file
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer
from firstfix.scan.reduction import voxel_means
from firstfix.scan.scan import Scan
from firstfix.transform import make_transform, pose_error, quaternion_of, transform_points
from firstfix_builder.pipeline import build_version
from firstfix_builder.sources.read_map import read_trajectory
from tests.needs import RECORDED, with_recorded

FOLDER = RECORDED / "rotation_in_place_11"
MAPPED, ASKED = range(0, 11, 2), (1, 5, 9)
MAP_M = 25.0  # further off single returns lie apart
TURNED = {
    "upright": np.eye(3),
    "head down": np.diag([1.0, -1.0, -1.0]),
    "on its side": Rotation.from_euler("x", 90, degrees=True).as_matrix(),
    "anyhow": Rotation.random(random_state=3).as_matrix(),
}

pytestmark = with_recorded(FOLDER.name)


@pytest.fixture(scope="module")
def poses():
    return read_trajectory(FOLDER / "pose.json")


@pytest.fixture(scope="module")
def localizer(poses, tmp_path_factory):
    """Builds a map from every second scan."""
    folder = tmp_path_factory.mktemp("rotation")
    seen = [transform_points(poses[n], read_scan_file(FOLDER / f"{n}.pcd").points) for n in MAPPED]
    cloud = np.concatenate(seen)
    np.savetxt(folder / "map.xyz", voxel_means(cloud[np.linalg.norm(cloud, axis=1) < MAP_M], 0.1), fmt="%.4f")
    track = [",".join(map(str, [*T[:3, 3], *quaternion_of(T)])) for T in poses]
    (folder / "track.csv").write_text("\n".join(["tx,ty,tz,qx,qy,qz,qw", *track]))
    config = {
        "sensor": "mid-360",
        "viewpoints": {"spacing_m": 1.0, "max_distance_to_trajectory_m": 4.0},
        "self_test": {"queries": 12, "outside": 6},
    }
    version = build_version(
        folder / "map.xyz", BuildConfig.parse(config), folder / "work", trajectory=folder / "track.csv"
    )
    return Localizer(MapIndex.load(version.directory))


@pytest.mark.parametrize("mounted", TURNED)
def test_the_place_is_found_in_any_mounting(localizer, poses, mounted):
    R_base_sensor = TURNED[mounted]
    for number in ASKED:
        scan = Scan.from_points(read_scan_file(FOLDER / f"{number}.pcd").points @ R_base_sensor)
        expected = poses[number] @ make_transform(R_base_sensor, np.zeros(3))
        off_m, off_deg = pose_error(expected, localizer.localize(scan).hypotheses[0].T_map_sensor)
        assert off_m < 0.05
        assert off_deg < 1.0
