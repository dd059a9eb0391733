"""Layout of the downloaded data set: its maps, bags and true poses. README.md names the sources."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from firstfix.transform import Matrix, make_transform
from firstfix_builder.read_map import read_trajectory

CLOUDS, IMU = "/livox/points", "/livox/imu"
GAP_S = 0.25  # between true poses; none is interpolated over a longer one


@dataclass(frozen=True)
class Recording:
    """One recording on one of the maps.

    Attributes:
        name: as in the name of its true poses.
        map_name: file of the map.
        parts: names of its bags, each of which is downloaded by itself.
    """

    name: str
    map_name: str
    parts: tuple[str, ...]


RECORDINGS = (
    Recording("outdoor_hard_01", "map_outdoor_hard.ply", ("outdoor_hard_01a", "outdoor_hard_01b")),
    Recording("outdoor_hard_02", "map_outdoor_hard.ply", ("outdoor_hard_02a", "outdoor_hard_02b")),
    Recording("outdoor_kidnap", "map_outdoor_kidnap.ply", ("outdoor_kidnap_a", "outdoor_kidnap_b")),
)


@dataclass(frozen=True)
class Files:
    """The files of a recording. ``bags`` has those parts that are there, in order."""

    map_path: Path
    poses: Path
    bags: tuple[Path, ...]


def files_of(data: Path, recording: Recording) -> Files | str:
    """Returns the files of a recording, in any folders below ``data``; or what is missing."""
    maps = sorted(data.rglob(recording.map_name))
    poses = sorted(data.rglob(f"traj_lidar_{recording.name}.txt"))
    bags = [bag for part in recording.parts if (bag := _bag(data, part)) is not None]
    found = {
        recording.map_name: maps,
        f"traj_lidar_{recording.name}.txt of gt.zip": poses,
        f"bag of {' or '.join(recording.parts)}": bags,
    }
    if missing := [name for name, files in found.items() if not files]:
        return f"skipped: {data} has no {', no '.join(missing)}"
    return Files(maps[0], poses[0], tuple(bags))


def _bag(data: Path, part: str) -> Path | None:
    """The folder of a ROS 2 bag that lies in a folder named after a part, or is that folder."""
    folders = (file.parent for file in sorted(data.rglob("metadata.yaml")))
    return next((folder for folder in folders if part in folder.relative_to(data).parts), None)


class TruePoses:
    """True poses of a sensor over time, interpolated.

    Args:
        stamp_s: (n,) in ascending order.
        T_map_sensor: (n, 4, 4), n >= 2.
    """

    def __init__(self, stamp_s: NDArray[np.float64], T_map_sensor: Sequence[Matrix]) -> None:
        poses = np.asarray(T_map_sensor)
        self._stamp_s, self._position_m = stamp_s, poses[:, :3, 3]
        self._turn = Slerp(stamp_s, Rotation.from_matrix(poses[:, :3, :3]))

    @classmethod
    def read(cls, path: Path) -> TruePoses:
        """Reads a file with ``stamp x y z qx qy qz qw`` in each line (TUM).

        Raises:
            MalformedData: it is no such file.
        """
        poses = read_trajectory(path)
        stamp_s = np.loadtxt(path, usecols=0)
        order = np.unique(stamp_s, return_index=True)[1]
        return cls(stamp_s[order], poses[order])

    def at(self, stamp_s: float) -> Matrix | None:
        """Returns the (4, 4) pose at this time; None where the true poses have a gap, begin or end."""
        after = int(np.searchsorted(self._stamp_s, stamp_s))
        if after < len(self._stamp_s) and self._stamp_s[after] == stamp_s:
            before = after
        elif 0 < after < len(self._stamp_s) and self._stamp_s[after] - self._stamp_s[after - 1] <= GAP_S:
            before = after - 1
        else:
            return None
        at = [
            np.interp(stamp_s, self._stamp_s[before : after + 1], p[before : after + 1])
            for p in self._position_m.T
        ]
        return make_transform(self._turn(stamp_s).as_matrix(), at)
