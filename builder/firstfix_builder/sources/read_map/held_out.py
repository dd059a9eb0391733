"""Held-out scans of a map: real scans with their poses, which are not among the map's points.

Confirmed queries of robots are such scans (``self_test.confirmed_scans``), and so are keyframes that a map is
made without (``held_out_parts.py``). Besides, a map's folder brings them in a folder of their own:

    held_out/poses.csv    columns scan (path from this folder) and tx,ty,tz,qx,qy,qz,qw (T_map_sensor)
    held_out/...          the scans, as ``firstfix localize`` reads them

The build's self-test asks them. What cannot be used is left out with a reason: the map is built all the same.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from firstfix.errors import InputError, NotFound
from firstfix.scan.compact import CompactScan
from firstfix.scan.scan import Scan
from firstfix.transform import Matrix

from .file_errors import naming
from .held_out_parts import HeldOutParts
from .posed_scans import POSES, pose_of, read_posed_scan, read_poses, why_not_read

FOLDER = "held_out"
MAX_SCANS, SEED = 40, 11  # the self-test asks: of more, these are drawn by chance
_SCANS_FILE, _RECORD_FILE = "held_out.npz", "held_out.json"


@dataclass(frozen=True)
class Confirmation:
    """Origin of a scan's true pose, and what it was asked with.

    Attributes:
        robot: pseudonym of the credential that asked; empty if it had none.
        told_by, told_at: who has told the place, and when (UTC, ISO 8601); empty if nobody can tell.
        options: about the scan, as ``LocalizeOptions.to_strings`` writes them.
    """

    robot: str
    told_by: str
    told_at: str
    options: Mapping[str, str]


@dataclass(frozen=True)
class HeldOutScan:
    """A real scan and where it was taken: T_map_sensor as it is read, T_level_sensor in the self-test.

    Attributes:
        confirmation: of a robot's query; None: the map's source brings the scan.
    """

    name: str
    scan: Scan | CompactScan
    T_sensor: Matrix
    confirmation: Confirmation | None = None


@dataclass(frozen=True)
class HeldOut:
    """The held-out scans of a map.

    Attributes:
        scans: in the order of the file.
        left_out: reasons by the name of the scan, or of the file of poses.
        of_map: what was held out of a map that is made of its scans; None: it is not, or nothing should be.
    """

    scans: tuple[HeldOutScan, ...] = ()
    left_out: Mapping[str, str] | None = None
    of_map: HeldOutParts | None = None

    @property
    def reasons(self) -> dict[str, str]:
        """``left_out``, empty if nothing was."""
        return dict(self.left_out or {})

    def with_those(self, other: HeldOut) -> HeldOut:
        """Both together, these first; ``of_map`` is of these."""
        return replace(self, scans=(*self.scans, *other.scans), left_out={**self.reasons, **other.reasons})

    def moved(self, T_level_map: Matrix) -> HeldOut:
        """The same scans with poses in another frame."""
        return replace(
            self, scans=tuple(replace(one, T_sensor=T_level_map @ one.T_sensor) for one in self.scans)
        )

    def save(self, directory: Path) -> None:
        """Write a stage's files. Times of points that are not known are NaN; a whole scan has no ranges."""
        scans = [one.scan for one in self.scans]
        times = [np.full(len(s.points), np.nan, np.float32) if s.time_s is None else s.time_s for s in scans]
        ranges = [s.nearest_m if isinstance(s, CompactScan) else np.empty(0, np.float32) for s in scans]
        np.savez(
            directory / _SCANS_FILE,
            names=np.array([one.name for one in self.scans], dtype=np.str_),
            T_sensor=np.array([one.T_sensor for one in self.scans]).reshape(-1, 4, 4),
            ends=np.cumsum([len(scan.points) for scan in scans], dtype=np.int64),
            points=np.concatenate([np.empty((0, 3), np.float32), *(scan.points for scan in scans)]),
            time_s=np.concatenate([np.empty(0, np.float32), *times]),
            range_ends=np.cumsum([len(some) for some in ranges], dtype=np.int64),
            nearest_m=np.concatenate([np.empty(0, np.float32), *ranges]),
        )
        confirmed = [None if one.confirmation is None else asdict(one.confirmation) for one in self.scans]
        of_map = None if self.of_map is None else self.of_map.to_mapping()
        record = {"left_out": self.reasons, "confirmed": confirmed, "of_map": of_map}
        (directory / _RECORD_FILE).write_text(json.dumps(record, sort_keys=True))

    @classmethod
    def load(cls, directory: Path) -> HeldOut:
        """Read what ``save`` wrote; nothing if it wrote nothing."""
        if not (directory / _SCANS_FILE).exists():
            return cls()
        record = json.loads((directory / _RECORD_FILE).read_text())
        with np.load(directory / _SCANS_FILE) as file:
            stored = {name: file[name] for name in file.files}
        parts = zip(
            stored["names"].tolist(),
            np.split(stored["points"], stored["ends"][:-1]),
            np.split(stored["time_s"], stored["ends"][:-1]),
            np.split(stored["nearest_m"], stored["range_ends"][:-1]),
            stored["T_sensor"],
            record["confirmed"],
            strict=False,  # of no scans, too, split makes one part
        )
        scans = [
            HeldOutScan(
                name,
                _scan_of(points, None if np.isnan(at).any() else at, ranges),
                T,
                None if told is None else Confirmation(**told),
            )
            for name, points, at, ranges, T, told in parts
        ]
        of_map = None if record["of_map"] is None else HeldOutParts(**record["of_map"])
        return cls(tuple(scans), record["left_out"], of_map)


def _scan_of(
    points: NDArray[np.float32], time_s: NDArray[np.float32] | None, nearest_m: NDArray[np.float32]
) -> Scan | CompactScan:
    if len(nearest_m):
        return CompactScan(points, nearest_m, time_s=time_s)
    return Scan.from_points(points, time_s=time_s)


def read_held_out(source: Path, axis: str, scale: float = 1.0) -> HeldOut | None:
    """Read the held-out scans of a map's folder; None if it has none. It raises nothing for bad ones.

    Args:
        axis, scale: of the map. Poses in a frame that is turned, or in another unit, are not read.
    """
    folder = source / FOLDER
    if not folder.is_dir():
        return None
    reason = why_not_read(axis, scale)
    if reason is not None:
        return HeldOut(left_out={FOLDER: reason})
    try:
        with naming(folder / POSES):
            rows = read_poses(folder / POSES)
    except (InputError, NotFound) as error:
        return HeldOut(left_out={f"{FOLDER}/{POSES}": str(error)})
    left_out = dict.fromkeys(_without_a_row(folder, {name for name, _ in rows}), "it has no pose")
    scans, asked = [], _drawn(len(rows))
    for number, (name, pose) in enumerate(rows):
        try:
            if number not in asked:
                left_out[name] = f"there are more than {MAX_SCANS}"
                continue
            scans.append(HeldOutScan(name, read_posed_scan(folder, name), pose_of(pose)))
        except ValueError as error:
            left_out[name] = str(error)
    return HeldOut(tuple(scans), left_out)


def _without_a_row(folder: Path, named: set[str]) -> Iterator[str]:
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder).as_posix()
        if path.is_file() and name != POSES and name not in named and not path.name.startswith("."):
            yield name


def _drawn(count: int) -> set[int]:
    """Numbers of the rows that are asked: all, or MAX_SCANS by chance."""
    return set(np.random.default_rng(SEED).permutation(count)[:MAX_SCANS].tolist())
