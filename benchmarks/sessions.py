"""Error of merged sessions on real maps: a map is cut in two by its drive, and one part is moved.

    python -m benchmarks.sessions hall street

Each point of the map goes into one part alone, so that the two clouds have no point in common. They share the
map's SLAM. So the figures do not say what the drift of two runs does to the alignment.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from firstfix.builds.config import BuildConfig
from firstfix.errors import BuildFailed
from firstfix.transform import (
    inverse,
    make_transform,
    rotation_angle_deg,
    rotation_between,
    rotation_z,
    transform_points,
)
from firstfix_builder.pipeline import read_source
from firstfix_builder.read_map import MapData, read_map
from firstfix_builder.sessions.stages import SESSIONS_FILE

from .common.datasets import GARAGE, HALL, STREET, YARD, Dataset

SIGHT_M = {"hall": 12.0, "street": 30.0, "yard": 25.0, "garage": 15.0}
TILT_DEG, AWAY_M = 3.0, 60.0


def main() -> None:
    """Prints one line of JSON for each data set."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    datasets = {one.name: one for one in (HALL, STREET, YARD, GARAGE)}
    parser.add_argument("datasets", nargs="+", choices=sorted(datasets))
    parser.add_argument("--first-until", type=float, default=0.6, help="share of the drive")
    parser.add_argument("--second-from", type=float, default=0.4, help="share of the drive")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    for name in given.datasets:
        with TemporaryDirectory() as folder:
            found = measure(datasets[name], Path(folder), given.first_until, given.second_from, given.seed)
        print(json.dumps(found), flush=True)


def measure(dataset: Dataset, folder: Path, until: float, since: float, seed: int) -> dict[str, object]:
    """Error at the corners of the second part's box, or why it was refused."""
    poses = folder / "trajectory.csv"
    dataset.write_trajectory(poses)
    whole = read_map(dataset.path / dataset.map_file, trajectory=poses)
    rng = np.random.default_rng(seed)
    T_map_second = _anywhere(rng)
    second = _cut(whole, folder, until, since, SIGHT_M[dataset.name], T_map_second, rng)
    begin_s, begin_cpu_s = time.monotonic(), time.process_time()
    result: dict[str, object] = {"dataset": dataset.name, "until": until, "from": since, "seed": seed}
    try:
        read_source(folder / "sessions", BuildConfig(), folder / "work")
    except BuildFailed as error:
        return result | {"refused": str(error)}
    result |= {
        "seconds": round(time.monotonic() - begin_s),
        "cpu_seconds": round(time.process_time() - begin_cpu_s),
    }
    record = json.loads(next((folder / "work").rglob(SESSIONS_FILE)).read_text())
    T_found = np.array(record[1]["T_map_session"])
    ends = np.stack([second.min(axis=0), second.max(axis=0)])
    corners = np.array([[ends[i, 0], ends[j, 1], ends[k, 2]] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
    off = transform_points(T_found, corners) - transform_points(T_map_second, corners)
    return result | {
        "corner_error_m": round(float(np.linalg.norm(off, axis=1).max()), 4),
        "turn_error_deg": round(rotation_angle_deg(T_map_second[:3, :3].T @ T_found[:3, :3]), 4),
        "points": [entry["points"] for entry in record],
        "removed_points": [entry["removed_points"] for entry in record],
        "evidence": record[1]["evidence"],
    }


def _cut(
    whole: MapData,
    folder: Path,
    until: float,
    since: float,
    sight_m: float,
    T_map_second: NDArray[np.float64],
    rng: np.random.Generator,
) -> NDArray[np.float64]:
    """Writes the folder of sessions; returns the second one's points."""
    assert whole.points is not None
    assert whole.trajectory is not None
    count, in_first = len(whole.trajectory), rng.random(len(whole.points)) < 0.5
    parts = (
        (whole.trajectory[: round(until * count)], in_first, np.eye(4)),
        (whole.trajectory[round(since * count) :], ~in_first, inverse(T_map_second)),
    )
    listed, cloud = [], whole.points
    for number, (drive, mine, T_session_map) in enumerate(parts):
        away_m, _ = cKDTree(drive[:, :3, 3]).query(whole.points, distance_upper_bound=sight_m)
        cloud = transform_points(T_session_map, whole.points[mine & np.isfinite(away_m)])
        target = folder / "sessions" / f"{number}"
        target.mkdir(parents=True)
        np.save(target / "cloud.npy", cloud)
        np.savetxt(target / "poses.txt", (T_session_map @ drive)[:, :3].reshape(-1, 12))
        listed.append({"source": f"{number}/cloud.npy", "trajectory": f"{number}/poses.txt"})
    (folder / "sessions/sessions.json").write_text(json.dumps({"sessions": listed}))
    return cloud


def _anywhere(rng: np.random.Generator) -> NDArray[np.float64]:
    """Any heading, a little tilt, tens of metres away."""
    lean = np.radians(rng.uniform(0, TILT_DEG))
    way = rng.uniform(0, 2 * np.pi)
    up = [np.sin(lean) * np.cos(way), np.sin(lean) * np.sin(way), np.cos(lean)]
    R = rotation_between([0, 0, 1], up) @ rotation_z(rng.uniform(-np.pi, np.pi))
    return make_transform(R, rng.uniform(-AWAY_M, AWAY_M, 3) * [1, 1, 0.05])


if __name__ == "__main__":
    main()
