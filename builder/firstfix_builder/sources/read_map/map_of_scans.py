"""A map that is made of the scans of its mapping run: all keyframes' points, put at their poses.

The source is a folder with ``mapping_scans/`` (``mapping_scans.py``) and no map file of its own, or the
scans of a SLAM program (``scan_folders.py``).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from firstfix.errors import MalformedData
from firstfix.scan.scan import Scan
from firstfix.transform import make_transform, transform_points

from ...mesh.intensity import Intensity
from .glim import is_glim_dump
from .held_out import HeldOut, HeldOutScan
from .held_out_parts import FEW, MIN_KEYFRAMES, HeldOutParts, OtherKeyframes, drawn_parts
from .joined_cloud import JoinedCloud
from .map_data import ORIGIN_STEP_M, MapData
from .map_file import READERS
from .map_folder import TRAJECTORIES
from .mapping_scans import MappingScans
from .posed_scans import POSES
from .scan_folders import scan_folder_in
from .visible_files import visible_files
from .what_was_read import LeftOut, WhatWasRead, plain

VOXEL_M = 0.05
MAX_POINTS = 8_000_000  # beyond it the voxels grow
NEAREST_M = 0.5  # nearer points are of the robot, or no return


@dataclass(frozen=True)
class MapOfScans:
    """A map, and the keyframes that it was made without.

    Attributes:
        data: points and trajectory, in the source's own frame. The trajectory is of the keyframes in the map
            alone: of any other pose, later stages would believe that the map has what is seen from there.
        held_out: with T_map_sensor.
        names_held_out: in the folder of the scans.
        left_out: reasons for the scans that are neither, by name.
    """

    data: MapData
    held_out: HeldOut
    names_held_out: frozenset[str]
    left_out: Mapping[str, str]


def is_map_of_scans(source: Path) -> bool:
    """Whether a source is a folder with mapping scans and without a map file, or of a program's scans."""
    found = scan_folder_in(source)
    if found is None or is_glim_dump(source):
        return False
    if found.program:
        return True
    files = [path for path in visible_files(source) if path.name not in TRAJECTORIES]
    return not any(path.suffix.lower() in READERS for path in files)


def read_map_of_scans(
    source: Path, axis: str, scale: float, *, held_out: int = 0, max_points: int = MAX_POINTS
) -> MapOfScans:
    """Join the scans of a folder. One part is in memory at a time, besides what is held out.

    Args:
        axis, scale: of the source; it must be z-up and in metres.
        held_out: largest number of keyframes that are held out.
        max_points: of the map.

    Raises:
        MalformedData: no scan can be used; the message has a reason.
        TooLarge, UnfitMap: the map is beyond the limits.
    """
    scans = MappingScans(source, axis, scale)
    keyframes = _Keyframes(scans)
    parts = drawn_parts(keyframes.positions, held_out)
    drawn = {number for part in parts for number in part}
    joined = _Joined(keyframes, max_points)
    for number in range(len(keyframes)):
        if number not in drawn:
            joined.add(number, keyframes.read(number))
    asked, told = _hold_out(parts, keyframes, joined)
    if held_out and len(keyframes) < MIN_KEYFRAMES:
        told = HeldOutParts(kept_out={FEW: len(keyframes)})
    if not joined.numbers:
        raise _nothing_to_join(scans)
    data = MapData(
        points=joined.cloud.points() + keyframes.origin,
        intensity=Intensity.of(joined.cloud.intensity()),
        trajectory=keyframes.T_map_sensor[sorted(joined.numbers)],
        read=_told(scans, [keyframes.names[number] for number in sorted(joined.numbers)]),
    )
    names = frozenset(one.name.removeprefix(f"{scans.name}/") for one in asked)
    return MapOfScans(data, HeldOut(asked, of_map=told if held_out else None), names, scans.left_out)


def _told(scans: MappingScans, names: Sequence[str]) -> WhatWasRead:
    """Record of the joined scans, and of those that are left out, by their reasons."""
    read = WhatWasRead(
        form=f"{scans.program}'s scans" if scans.program else "a folder of scans",
        program=scans.program,
        unit="metre",
        clouds=tuple(names),
        poses="poses of the scans",
    )
    return read.without(*(LeftOut("scans", plain(reason)) for reason in scans.left_out.values()))


def _hold_out(
    parts: list[range], keyframes: _Keyframes, joined: _Joined
) -> tuple[tuple[HeldOutScan, ...], HeldOutParts]:
    """Hold out the parts that the map can do without, and join the others after all."""
    if not parts:
        return (), HeldOutParts()
    others = OtherKeyframes(joined.cloud.points(), keyframes.near_origin(joined.numbers))
    asked: list[HeldOutScan] = []
    number_of_parts, kept_out = 0, Counter[str]()
    for part in parts:
        read = {number: scan for number in part if (scan := keyframes.read(number)) is not None}
        reasons = (
            others.why_kept(keyframes.placed(number, scan), keyframes.near_origin([number])[0])
            for number, scan in read.items()
        )
        reason = next((reason for reason in reasons if reason is not None), None)
        if reason is None:
            number_of_parts += bool(read)
            asked += [keyframes.held_out(number, scan) for number, scan in read.items()]
            continue
        kept_out[reason] += len(read)
        for number, scan in read.items():
            joined.add(number, scan)
    return tuple(asked), HeldOutParts(len(asked), number_of_parts, dict(kept_out))


class _Keyframes:
    """The scans that have a pose, in the order of the drive, near an origin."""

    def __init__(self, scans: MappingScans) -> None:
        posed = list(scans.posed())
        self._scans = scans
        self.names = [name for name, _ in posed]
        self.T_map_sensor: NDArray[np.float64] = np.array([T for _, T in posed]).reshape(-1, 4, 4)
        # a multiple of a step: another first scan of the same place leaves the voxels where they are
        first = self.positions[0] if posed else np.zeros(3)
        self.origin: NDArray[np.float64] = np.floor(first / ORIGIN_STEP_M) * ORIGIN_STEP_M

    def __len__(self) -> int:
        return len(self.names)

    @property
    def positions(self) -> NDArray[np.float64]:
        """(n, 3) in the map frame."""
        return self.T_map_sensor[:, :3, 3]

    def near_origin(self, numbers: Sequence[int]) -> NDArray[np.float64]:
        """(k, 3) positions of some, from the origin."""
        return self.positions[list(numbers)] - self.origin

    def read(self, number: int) -> Scan | None:
        """The scan; None: it cannot be read, and is left out."""
        return self._scans.read_scan(self.names[number])

    def placed(self, number: int, scan: Scan) -> NDArray[np.float64]:
        """(n, 3) the scan's points without the nearest, in the map's axes, from the origin."""
        far = scan.points[_is_far(scan)]
        T = make_transform(np.eye(3), -self.origin) @ self.T_map_sensor[number]
        return transform_points(T, far.astype(np.float64))

    def held_out(self, number: int, scan: Scan) -> HeldOutScan:
        """The scan as the self-test asks it. A scan of ``held_out/`` may have the same name."""
        return HeldOutScan(f"{self._scans.name}/{self.names[number]}", scan, self.T_map_sensor[number])


def _is_far(scan: Scan) -> NDArray[np.bool_]:
    """Which points are neither of the robot nor no return."""
    is_far: NDArray[np.bool_] = np.linalg.norm(scan.points, axis=1) >= NEAREST_M
    return is_far


class _Joined:
    """The keyframes that are in the map.

    Attributes:
        numbers: in the order in which they were joined.
    """

    def __init__(self, keyframes: _Keyframes, max_points: int) -> None:
        self._keyframes = keyframes
        self.cloud = JoinedCloud(VOXEL_M, max_points)
        self.numbers: list[int] = []

    def add(self, number: int, scan: Scan | None) -> None:
        """Join a scan that could be read."""
        if scan is not None:
            brightness = None if scan.intensity is None else scan.intensity[_is_far(scan)]
            self.cloud.add(self._keyframes.placed(number, scan), brightness)
            self.numbers.append(number)


def _nothing_to_join(scans: MappingScans) -> MalformedData:
    name, reason = next(iter(scans.left_out.items()), (POSES, "it lists no scan"))
    return MalformedData(f"no scan of {scans.name}/ can be used: {name}: {reason.removeprefix(f'{name}: ')}")
