"""The same answer at every yaw and tilt: real scans of the hall, turned as in another mount."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from firstfix.answer.localization import Verdict
from firstfix.decode import read_scan_file
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer
from firstfix.transform import make_transform
from firstfix_cli.poses_csv import read_poses_csv
from tests.recorded_data import HALL

pytestmark = pytest.mark.slow
YAWS, TILTS, TILT_DEG = 36, 5, 8.0
SCANS = (0, 2, 4)
# Most scans end within 1 cm. A scan with two minima side by side may end in either, up to 4.2 cm apart.
SAME_M = 0.05
TRUE_M = 0.1  # the reference poses are good to this


def turns() -> list[np.ndarray]:
    """Rotations: evenly in yaw, then a few with roll and pitch too."""
    rng = np.random.default_rng(10)
    level = [(yaw, 0.0, 0.0) for yaw in 360 / YAWS * (np.arange(YAWS) + rng.uniform())]
    tilted = [(rng.uniform(0, 360), *rng.uniform(-TILT_DEG, TILT_DEG, 2)) for _ in range(TILTS)]
    return [Rotation.from_euler("zyx", angles, degrees=True).as_matrix() for angles in (*level, *tilted)]


@pytest.mark.parametrize("number", SCANS)
def test_verdict_and_pose_do_not_depend_on_the_yaw(hall_directory: Path, tmp_path: Path, number: int):
    row = read_poses_csv(HALL.write_queries(tmp_path / "poses.csv"))[number]
    scan, localizer = read_scan_file(row.path), Localizer(MapIndex.load(hall_directory))
    verdicts, position_m = set(), []
    for R in turns():
        turned = replace(scan, points=(np.asarray(scan.points, np.float64) @ R.T).astype(np.float32))
        answer = localizer.localize(turned)
        verdicts.add(answer.verdict)
        assert answer.T_map_sensor is not None
        position_m.append((answer.T_map_sensor @ make_transform(R, np.zeros(3)))[:3, 3])
    assert verdicts == {Verdict.LOCALIZED}
    off_m = np.linalg.norm(np.array(position_m) - np.median(position_m, axis=0), axis=1)
    assert off_m.max() < SAME_M
    assert np.linalg.norm(np.median(position_m, axis=0) - row.T_map_sensor[:3, 3]) < TRUE_M
