"""Held-out scans of a map: real scans with their poses, which are not among the map's points.

A map's folder brings them in a folder of their own:

    held_out/poses.csv    columns scan (path from this folder) and tx,ty,tz,qx,qy,qz,qw (T_map_sensor)
    held_out/...          the scans, as ``firstfix localize`` reads them

The build's self-test asks them. What cannot be used is left out with a reason: the map is built all the same.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from firstfix.errors import InputError, NotFound
from firstfix.scan.scan import Scan
from firstfix.transform import Matrix

from .file_errors import naming
from .posed_scans import POSES, pose_of, read_posed_scan, read_poses, why_not_read

FOLDER = "held_out"
MAX_SCANS, SEED = 40, 11  # the self-test asks: of more, these are drawn by chance
_SCANS_FILE, _LEFT_OUT_FILE = "held_out.npz", "held_out.json"


@dataclass(frozen=True)
class HeldOutScan:
    """A real scan and where it was taken: T_map_sensor as it is read, T_level_sensor in the self-test."""

    name: str
    scan: Scan
    T_sensor: Matrix


@dataclass(frozen=True)
class HeldOut:
    """The held-out scans of a map.

    Attributes:
        scans: in the order of the file.
        left_out: reasons by the name of the scan, or of the file of poses.
    """

    scans: tuple[HeldOutScan, ...] = ()
    left_out: Mapping[str, str] | None = None

    @property
    def reasons(self) -> dict[str, str]:
        """``left_out``, empty if nothing was."""
        return dict(self.left_out or {})

    def moved(self, T_level_map: Matrix) -> HeldOut:
        """The same scans with poses in another frame."""
        return replace(
            self, scans=tuple(replace(one, T_sensor=T_level_map @ one.T_sensor) for one in self.scans)
        )

    def save(self, directory: Path) -> None:
        """Writes a stage's files. Times of points that are not known are NaN."""
        scans = [one.scan for one in self.scans]
        times = [np.full(len(s.points), np.nan, np.float32) if s.time_s is None else s.time_s for s in scans]
        np.savez(
            directory / _SCANS_FILE,
            names=np.array([one.name for one in self.scans], dtype=np.str_),
            T_sensor=np.array([one.T_sensor for one in self.scans]).reshape(-1, 4, 4),
            ends=np.cumsum([len(scan.points) for scan in scans], dtype=np.int64),
            points=np.concatenate([np.empty((0, 3), np.float32), *(scan.points for scan in scans)]),
            time_s=np.concatenate([np.empty(0, np.float32), *times]),
        )
        (directory / _LEFT_OUT_FILE).write_text(json.dumps(self.reasons, sort_keys=True))

    @classmethod
    def load(cls, directory: Path) -> HeldOut:
        """Reads what ``save`` wrote; nothing if it wrote nothing."""
        if not (directory / _SCANS_FILE).exists():
            return cls()
        with np.load(directory / _SCANS_FILE) as file:
            stored = {name: file[name] for name in file.files}
        parts = zip(
            np.split(stored["points"], stored["ends"][:-1]),
            np.split(stored["time_s"], stored["ends"][:-1]),
            strict=True,
        )
        scans = [Scan.from_points(xyz, time_s=None if np.isnan(at).any() else at) for xyz, at in parts]
        named = zip(stored["names"].tolist(), scans, stored["T_sensor"], strict=False)
        left_out = json.loads((directory / _LEFT_OUT_FILE).read_text())
        return cls(tuple(HeldOutScan(name, scan, T) for name, scan, T in named), left_out)


def read_held_out(source: Path, axis: str, scale: float = 1.0) -> HeldOut | None:
    """Reads the held-out scans of a map's folder; None if it has none. It raises nothing for bad ones.

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
